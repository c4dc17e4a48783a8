"""What CI reads of the licences of packages, and which of them it lets pass."""

import runpy
from pathlib import Path

import pytest

SCRIPT = runpy.run_path(str(Path(__file__).parents[2] / ".ci/licences.py"))


@pytest.fixture
def page(tmp_path, monkeypatch):
    """A page of licences to write to, in the place of the project's."""
    file = tmp_path / "licences.md"
    file.write_text("# Licences\n\nbefore\n\n| package | licence |\n|---|---|\n| old | MIT |\n\nafter\n")
    monkeypatch.setitem(SCRIPT["main"].__globals__, "PAGE", file)
    return file


def package(name, *licences):
    return {"name": name, "version": "1.0", "licenses": [{"license": licence} for licence in licences]}


@pytest.mark.parametrize(
    ("expression", "outcome"),
    [
        ("MIT", True),
        ("MPL-2.0 AND (Apache-2.0 OR MIT)", True),
        ("GPL-3.0-only OR MIT", True),
        ("Apache-2.0 WITH LLVM-exception", True),
        ("GPL-3.0-only AND MIT", False),
        ("LGPL-2.1-or-later", False),
        ("", False),
        ("License :: OSI Approved :: GNU General Public License (GPL)", False),
        ("all rights reserved", False),
    ],
)
def test_all_licences_that_bind_at_once_must_be_allowed(expression, outcome):
    assert SCRIPT["allowed"](expression) is outcome


@pytest.mark.parametrize(
    ("licences", "expression"),
    [
        ([{"id": "MIT"}], "MIT"),
        ([{"name": "License :: OSI Approved :: BSD License"}], "BSD"),
        ([{"id": "BSD-3-Clause"}, {"name": "License :: OSI Approved :: BSD License"}], "BSD-3-Clause"),
        ([{"id": "MIT"}, {"id": "GPL-3.0-only"}], "MIT AND GPL-3.0-only"),
        ([], ""),
    ],
)
def test_what_a_package_tells_of_itself_is_one_expression(licences, expression):
    assert SCRIPT["licence"](package("some", *licences)) == expression


def test_the_table_is_made_anew_and_the_rest_of_the_page_stays(page, capsys):
    bill = {
        "components": [package("b", {"id": "MIT"}), package("a", {"id": "ISC"}), package("nvidia-x", {"name": "N"})]
    }
    assert SCRIPT["main"](bill, write=True) == 0
    assert page.read_text() == (
        "# Licences\n\nbefore\n\n| package | licence |\n|---|---|\n| a | ISC |\n| b | MIT |\n\nafter\n"
    )
    assert SCRIPT["main"](bill, write=False) == 0


def test_what_is_not_allowed_or_not_on_the_page_fails_by_name(page, capsys):
    assert (
        SCRIPT["main"]({"components": [package("old", {"id": "GPL-3.0-only"}), package("new", {"id": "MIT"})]}, False)
        == 1
    )
    assert capsys.readouterr().out.splitlines() == [
        "new is not on docs/licences.md: make its table anew by --write",
        "old 1.0: GPL-3.0-only is not among those allowed",
        "licences of 2 packages read",
    ]
