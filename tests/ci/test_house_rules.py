"""Rules on tests that no linter knows: short files, readable names, and no two files of one name."""

import re
from collections import Counter
from pathlib import Path

import pytest

TESTS = Path(__file__).parents[1]
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
