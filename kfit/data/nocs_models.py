"""Object models of CAMERA25 and REAL275: the model, mesh and box size of each object in a frame."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

# Bytes of three numbers with their header, and some.
_LARGEST_SCALE = 10_000


@dataclass(frozen=True)
class NOCSModel:
    """A model by its name in the meta file.

    Attributes:
        name: ShapeNet's ``synset/id`` for CAMERA, the scan's own for REAL275.
        mesh: its OBJ file, for `kfit.data.mesh_files.load_mesh`; None without a folder of models.
        size: (3,) extents over the box's diagonal; None if no file has them.
    """

    name: str
    mesh: Path | None = None
    size: NDArray[np.float64] | None = None


def read_meta(path: Path, models: str | Path | None) -> dict[int, tuple[int, NOCSModel]]:
    """Read class number and model by instance number from a frame's ``_meta.txt``; class 0 is clutter.

    A line has an instance, a class, and the model: a scan's name, or ShapeNet's synset and identifier.

    Args:
        path: the meta file.
        models: folder of the models of this part of the data.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: if a line has another form.
    """
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    found = {}
    for line in path.read_text().splitlines():
        words = line.split()
        if not words:
            continue
        if len(words) not in (3, 4) or not (words[0].isdigit() and words[1].isdigit()):
            raise ValueError(f"{path} must list instance, class and model on a line, got {line!r}")
        found[int(words[0])] = int(words[1]), _model(words[2:], None if models is None else Path(models))
    return found


def _model(words: list[str], folder: Path | None) -> NOCSModel:
    name = "/".join(words)
    if Path(name).is_absolute() or ".." in Path(name).parts:
        raise ValueError(f"the meta file names a model outside of the folder of models: {name!r}")
    if folder is None:
        return NOCSModel(name)
    if len(words) == 2:
        return NOCSModel(name, folder / name / "model.obj", _size_from_corners(folder / name / "bbox.txt"))
    if name.endswith(".npz"):  # some scans of the validation part
        scan = name.removesuffix(".npz")
        return NOCSModel(scan, folder / f"{scan}_norm.obj", _size_from_npz(folder / name))
    return NOCSModel(name, folder / f"{name}.obj", _size_from_extents(folder / f"{name}.txt"))


def _size_from_corners(path: Path) -> NDArray[np.float64] | None:
    """CAMERA's: two opposite corners of a box whose diagonal is 1."""
    numbers = _numbers(path, 6)
    return None if numbers is None else np.abs(numbers[:3] - numbers[3:])


def _size_from_extents(path: Path) -> NDArray[np.float64] | None:
    """REAL275's: extents in metres."""
    numbers = _numbers(path, 3)
    return None if numbers is None else numbers / np.linalg.norm(numbers)


def _size_from_npz(path: Path) -> NDArray[np.float64] | None:
    if not path.is_file():
        return None
    try:
        with np.load(path, allow_pickle=False) as file:
            unpacked = sum(part.file_size for part in file.zip.infolist() if part.filename == "scale.npy")
            scale = np.asarray(file["scale"], np.float64) if unpacked <= _LARGEST_SCALE else np.zeros(0)
    except (OSError, KeyError, ValueError, AttributeError, BadZipFile):
        scale = np.zeros(0)
    if scale.shape != (3,) or not np.isfinite(scale).all() or not scale.any():
        raise ValueError(f"{path} must hold three numbers of a box, its scale")
    return scale / np.linalg.norm(scale)


def _numbers(path: Path, count: int) -> NDArray[np.float64] | None:
    if not path.is_file():
        return None
    try:
        numbers = np.array(path.read_text().split(), np.float64)
    except ValueError:
        numbers = np.zeros(0)
    if len(numbers) != count or not np.isfinite(numbers).all() or not numbers.any():
        raise ValueError(f"{path} must hold {count} numbers of a box")
    return numbers
