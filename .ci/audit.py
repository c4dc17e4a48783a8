"""Asks the databases of known vulnerabilities about every version that .ci/constraints.txt pins, by pip-audit.

Exit status 1 where a version has a known hole, a release mends it, and ``audit_ignored.txt`` beside this file does not
tell why it may stay. A hole that no release mends is told. Where no database answers, as without a network, that is
told, and the status is 0.
"""

import json
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).parent
PINS = HERE / "constraints.txt"
# The package index's own advisories, then OSV, for where the index is a mirror that has none.
DATABASES = ("pypi", "osv")


def asked(database: str, ignored: list[str]) -> list[dict] | None:
    """What pip-audit tells of each pinned package; None where it could tell nothing."""
    command = [sys.executable, "-m", "pip_audit", "-r", str(PINS), "--no-deps", "--disable-pip", "--format", "json"]
    command += ["--progress-spinner", "off", "--vulnerability-service", database]
    for name in ignored:
        command += ["--ignore-vuln", name]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=300)
        return json.loads(done.stdout)["dependencies"]
    except (subprocess.TimeoutExpired, json.JSONDecodeError):
        return None


def judge(packages: list[dict]) -> tuple[list[str], int, bool]:
    """Lines to print, how many packages were looked up, and whether a hole is there that a release mends."""
    lines, mendable = [], False
    known = [package for package in packages if "skip_reason" not in package]
    for package in known:
        for hole in package["vulns"]:
            mended = ", ".join(hole["fix_versions"])
            mendable = mendable or bool(mended)
            lines.append(f"{package['name']} {package['version']}: {hole['id']}, mended in {mended or 'no release'}")
    return lines, len(known), mendable


def main() -> int:
    """The exit status."""
    lines = (HERE / "audit_ignored.txt").read_text().splitlines()
    ignored = [line.split()[0] for line in lines if line.strip() and not line.startswith("#")]
    for database in DATABASES:
        packages = asked(database, ignored) or []
        lines, known, mendable = judge(packages)
        if known:
            print("\n".join([*lines, f"{database} knows {known} of {len(packages)} pinned packages"]))
            return int(mendable)
        print(f"no answer from the database {database}")
    print("known vulnerabilities were NOT looked up: no database answers from here")
    return 0


if __name__ == "__main__":
    sys.exit(main())
