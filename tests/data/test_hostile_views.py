"""Files of views whose values cannot be: each gets one sentence."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from kfit.data.rendered_views import build_views
from kfit.data.views import Views

GOOD = {
    "images": np.full((2, 8, 8, 3), 255, np.uint8),
    "poses": np.zeros((2, 2), np.float32),
    "depth": np.zeros((2, 8, 8), np.float16),
    "extents": np.full((1, 3), 0.5, np.float32),
}


def times(file: h5py.File, name: str) -> None:
    h5py.h5d.create(file.id, name.encode(), h5py.h5t.UNIX_D32LE, h5py.h5s.create_simple((2, 2)))


def nothing(file: h5py.File, name: str) -> None:
    file.create_dataset(name, data=h5py.Empty("u1"))


def unwritten(file: h5py.File, name: str) -> None:
    file.create_dataset(name, (3000, 1024, 1024, 4), np.uint8, chunks=(1, 1024, 1024, 4))


def half_written(file: h5py.File, name: str) -> None:
    file.create_dataset(name, (2, 8, 8, 3), np.uint8, chunks=(1, 8, 8, 3))[0] = 1


def filled(value: float) -> Callable[[h5py.File, str], None]:
    def write(file: h5py.File, name: str) -> None:
        file[name] = np.full(GOOD[name].shape, value)

    return write


WRONG: list[tuple[str, Callable[[h5py.File, str], None], str]] = [
    ("images", nothing, "images must hold values"),
    ("images", unwritten, "images must be complete"),
    ("images", half_written, "images must be complete"),
    ("poses", times, "cannot be read"),
    ("poses", filled(1e200), "finite degrees"),
    ("poses", filled(np.inf), "finite degrees"),
    ("depth", filled(np.nan), "depth must be finite"),
    ("extents", filled(np.nan), "extents must be finite and at least 0"),
    ("extents", filled(-1.0), "extents must be finite and at least 0"),
    ("extents", filled(0.0), "extents must be finite and at least 0"),
]


@pytest.mark.parametrize(("wrong", "write", "sentence"), WRONG)
def test_values_that_cannot_be_get_a_sentence(
    wrong: str, write: Callable[[h5py.File, str], None], sentence: str, tmp_path: Path
) -> None:
    with h5py.File(tmp_path / "views.h5", "w") as file:
        for name, value in GOOD.items():
            if name == wrong:
                write(file, name)
            else:
                file[name] = value
    with pytest.raises(ValueError, match=sentence) as error:
        Views(tmp_path / "views.h5", 2)
    assert "views.h5" in str(error.value)
    assert len(str(error.value).splitlines()) == 1


def test_attributes_of_a_strange_type_are_refused_and_built_over(tmp_path: Path) -> None:
    path = tmp_path / "views.h5"
    with h5py.File(path, "w") as file:
        file.attrs["settings"] = file.attrs["num_views"] = h5py.Empty("f4")
        for name, value in GOOD.items():
            file[name] = value
    with pytest.raises(ValueError, match="num_views must divide"):
        Views(path)
    assert Views(build_views(path, "mug", 1, 2, 16)).num_views == 2


def test_good_values_are_read(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "views.h5", "w") as file:
        for name, value in GOOD.items():
            file[name] = value
    assert Views(tmp_path / "views.h5", 2).depth is not None
