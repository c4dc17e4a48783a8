"""Rules that no linter knows: short files, readable names in the field's words, and no two files of one name."""

import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from types import CodeType

import pytest

TESTS = Path(__file__).parents[1]
# For the words on the left, the field has others: objective, observed, message, inputs, defaults, tracker, rotated.
OLD_WORDS = set(
    re.findall(
        r"\w+",
        """
        judge judged judges sighting sightings seen verdict sure doubt doubts said told tell tells teller given usual
        follower followed following photograph disturb handed beside painted turned tipped looks faint careful
        """,
    )
)
# Of Hypothesis, and of a message by jsonargparse.
OTHERS_NAMES = {"given", "GIVEN_VALUE"}
FILES = sorted(TESTS.rglob("*.py"))


@pytest.mark.parametrize("file", FILES, ids=lambda file: str(file.relative_to(TESTS)))
def test_a_file_of_tests_is_short_and_so_are_its_names(file):
    lines = file.read_text().splitlines()
    assert len(lines) <= 400
    names = [name for line in lines for name in re.findall(r"^\s*def (test_\w+)", line)]
    assert [name for name in names if len(name) >= 80] == []


def test_files_of_tests_have_names_of_their_own():
    named = Counter(file.name for file in FILES if file.name != "conftest.py")
    assert [name for name, count in named.items() if count > 1] == []


def names_in(code: CodeType) -> Iterator[str]:
    """Names of functions, classes, arguments, variables and attributes."""
    if not code.co_name.startswith("test_"):
        yield code.co_name
    yield from (*code.co_varnames, *code.co_cellvars, *code.co_names)
    for part in code.co_consts:
        if isinstance(part, CodeType):
            yield from names_in(part)


def words_of(name: str) -> set[str]:
    return {word.lower() for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+", name)}


@pytest.mark.parametrize(
    "folder", [TESTS, TESTS.parent / "kfit", TESTS.parent / "examples"], ids=lambda path: path.name
)
def test_names_are_the_fields_own(folder):
    found = set()
    for file in folder.rglob("*.py"):
        code = compile(file.read_text(), str(file), "exec", dont_inherit=True)
        names = {name for name in names_in(code) if not name.startswith("test_")} - OTHERS_NAMES
        found |= {f"{file.relative_to(folder)}: {name}" for name in names if words_of(name) & OLD_WORDS}
    assert sorted(found) == []
