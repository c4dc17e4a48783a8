"""Files are there whole or not at all."""

from __future__ import annotations

from pathlib import Path

import pytest

from kfit.runtime.atomic_write import atomic_write


def _writes(text: str):
    return lambda path: path.write_text(text)


def _fails(path: Path) -> None:
    path.write_text("half")
    raise OSError("no space left")


def test_all_are_written_into_a_folder_that_was_not_there(tmp_path):
    made = atomic_write(tmp_path / "a" / "b", {"one": _writes("1"), "two": _writes("2")})
    assert [path.read_text() for path in made] == ["1", "2"]
    assert sorted(p.name for p in (tmp_path / "a" / "b").iterdir()) == ["one", "two"]


def test_one_that_fails_leaves_all_as_they_were(tmp_path):
    atomic_write(tmp_path, {"one": _writes("old")})
    with pytest.raises(OSError, match="no space"):
        atomic_write(tmp_path, {"one": _writes("new"), "two": _fails})
    assert {p.name: p.read_text() for p in tmp_path.iterdir()} == {"one": "old"}


def test_what_finds_nothing_to_write_is_left_out(tmp_path):
    assert atomic_write(tmp_path, {"one": lambda path: None}) == []
    assert not list(tmp_path.iterdir())


def test_an_absolute_path_is_written_where_it_says(tmp_path):
    elsewhere = tmp_path / "c" / "two"
    assert atomic_write(tmp_path / "a", {"one": _writes("1"), str(elsewhere): _writes("2")}) == [
        tmp_path / "a/one",
        elsewhere,
    ]
    assert elsewhere.read_text() == "2"
    with pytest.raises(OSError, match="no space"):
        atomic_write(tmp_path / "a", {str(elsewhere): _writes("new"), "one": _fails})
    assert sorted(p.read_text() for p in tmp_path.rglob("*") if p.is_file()) == ["1", "2"]
