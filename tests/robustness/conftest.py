"""Hypothesis keeps what it collects out of the tree; what several files fit."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import pytest
from blobs import THREADS, view_of
from hypothesis.configuration import set_hypothesis_home_dir

import kfit
from kfit.pose import CategoryModel

set_hypothesis_home_dir(tempfile.mkdtemp(prefix="hypothesis"))


@pytest.fixture(scope="module")
def mug() -> CategoryModel:
    return kfit.load("mug")


@pytest.fixture(scope="module")
def photos() -> list[Any]:
    return [view_of("mug", number) for number in range(THREADS)]


@pytest.fixture
def scratch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of temporary files that nobody else writes to."""
    (tmp_path / "scratch").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "scratch"))
    return tmp_path / "scratch"
