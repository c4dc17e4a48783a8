"""What CI makes of the answers about known vulnerabilities, and of none."""

import runpy
from pathlib import Path

import pytest

SCRIPT = runpy.run_path(str(Path(__file__).parents[2] / ".ci/audit.py"))
UNKNOWN = {"name": "a", "skip_reason": "not found"}
SAFE = {"name": "b", "version": "1.0", "vulns": []}
MENDED = {"name": "c", "version": "1.0", "vulns": [{"id": "CVE-1", "fix_versions": ["1.1"]}]}
OPEN = {"name": "d", "version": "1.0", "vulns": [{"id": "CVE-2", "fix_versions": []}]}


@pytest.mark.parametrize(
    ("answers", "status", "message"),
    [
        ({"pypi": [SAFE, UNKNOWN]}, 0, ["pypi knows 1 of 2 pinned packages"]),
        ({"pypi": [SAFE, MENDED]}, 1, ["c 1.0: CVE-1, mended in 1.1", "pypi knows 2 of 2 pinned packages"]),
        ({"pypi": [OPEN]}, 0, ["d 1.0: CVE-2, mended in no release", "pypi knows 1 of 1 pinned packages"]),
        # A mirror that has no advisories skips every package, which pip-audit calls "no known vulnerabilities".
        ({"pypi": [UNKNOWN], "osv": [SAFE]}, 0, [
            "no answer from the database pypi",
            "osv knows 1 of 1 pinned packages",
        ]),
        ({}, 0, [
            "no answer from the database pypi",
            "no answer from the database osv",
            "known vulnerabilities were NOT looked up: no database answers from here",
        ]),
    ],
)  # fmt: skip
def test_a_fixed_vulnerability_fails_and_silence_is_reported(answers, status, message, monkeypatch, capsys):
    monkeypatch.setitem(SCRIPT["main"].__globals__, "asked", lambda database, ignored: answers.get(database))
    assert SCRIPT["main"]() == status
    assert capsys.readouterr().out.splitlines() == message
