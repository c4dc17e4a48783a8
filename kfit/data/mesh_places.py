"""Where meshes lie and how they stand, in the words of ``--data.meshes`` and of ``--meshes`` of every command."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kfit.core.check import check_text
from kfit.data.mesh import Mesh
from kfit.data.mesh_files import find_meshes, load_mesh
from kfit.data.mesh_tree import mesh_identities
from kfit.geometry import Category

AXES = {"x": (1, 0, 0), "-x": (-1, 0, 0), "y": (0, 1, 0), "-y": (0, -1, 0), "z": (0, 0, 1), "-z": (0, 0, -1)}
# The front where none is told: the axis that the shortest turn takes to +x once the up axis is at +y.
_FRONTS = {"y": "x", "-y": "x", "z": "x", "-z": "x", "x": "-y", "-x": "y"}
_PLACE = re.compile(r"(?:([A-Za-z][\w-]*)=)?(.+?)(?:@([^@/,]+)(?:,([^@/,]+))?)?")


@dataclass(frozen=True)
class MeshFile:
    """A mesh file, and how the object stands in it.

    Attributes:
        path: path of the file.
        category: category of the object, None where nobody said.
        up: axis of the file that points up, such as ``"y"`` or ``"-z"``.
        front: axis of the file that becomes +x, the category's front; where none is given, the one that the shortest
            turn takes there.
    """

    path: Path
    category: str | None = None
    up: str = "y"
    front: str = ""

    def __post_init__(self) -> None:
        if not self.front:
            object.__setattr__(self, "front", _FRONTS[self.up])

    @property
    def name(self) -> str:
        """The object's: that of its folder, or the file's where it lies in one with others."""
        alone = len(find_meshes(self.path.parent)) == 1
        return self.path.parent.name if alone else self.path.stem

    @property
    def rotation(self) -> NDArray[np.float64]:
        """Rotation (3, 3) from the file's axes to the category's: up to +y, front to +x."""
        up, front = (np.array(AXES[axis], float) for axis in (self.up, self.front))
        return np.stack([front, up, np.cross(front, up)])

    def mesh(self) -> Mesh:
        """The object y up, its front at +x, its box's centre at the origin and its diagonal 1.

        Raises:
            FileNotFoundError, ValueError: those of `kfit.data.mesh_files.load_mesh`.
        """
        turn = np.eye(4)
        turn[:3, :3] = self.rotation
        return load_mesh(self.path).transformed(turn).normalised()


def find_mesh_files(places: str | Sequence[str], categories: Collection[str] = ()) -> list[MeshFile]:
    """Find mesh files by words that tell where they lie and how they stand, sorted by path within a place.

    Args:
        places: ``FOLDER`` or ``FILE``, one or several; before it ``CATEGORY=``, behind it ``@UP`` or ``@UP,FRONT``,
            axes of the file such as ``@z`` or, as ShapeNet has them, ``@y,-z``. Without these y is up and the front at
            +x. A file that several places hold stands as the last of them says; a category that one of them tells it
            keeps.
        categories: names that may stand before a place.

    Raises:
        FileNotFoundError, ValueError: for a place that is none of these, or holds no mesh.
    """
    found: dict[Path, MeshFile] = {}
    for place in [places] if isinstance(places, str) else places:
        category, path, up, front = _parts(place, categories)
        for file in [path] if path.is_file() else find_meshes(path):
            before = found.pop(file.resolve(), None)
            kept = category if category is not None or before is None else before.category
            if before is not None and "@" not in place:
                up, front = before.up, before.front
            found[file.resolve()] = MeshFile(file, kept, up, front)
    return list(found.values())


def check_mesh_file(name: str, file: object) -> None:
    """Refuse what is neither a path nor a mesh file.

    Raises:
        TypeError: naming the argument.
    """
    check_text(name, file.path if isinstance(file, MeshFile) else file)


def as_mesh_file(file: str | Path | MeshFile) -> MeshFile:
    """Take a path for a mesh with y up and its front at +x."""
    return file if isinstance(file, MeshFile) else MeshFile(Path(file))


def source_identity(source: str | Category | Sequence[MeshFile]) -> str | list[str]:
    """What tells objects from others: a category's name, or names, contents and axes of mesh files."""
    if isinstance(source, str | Category):
        return source if isinstance(source, str) else source.name
    contents = mesh_identities([file.path for file in source])
    axes = ["" if (file.up, file.front) == ("y", "x") else f" @{file.up},{file.front}" for file in source]
    return [content + stands for content, stands in zip(contents, axes, strict=True)]


def _parts(place: str, categories: Collection[str]) -> tuple[str | None, Path, str, str]:
    """Category, path, up and front of a place."""
    if Path(place).exists():  # whatever signs its name holds
        return None, Path(place), "y", "x"
    told = _PLACE.fullmatch(place)
    if told is None:
        raise ValueError(f"a place of meshes must be FOLDER, FOLDER@UP or CATEGORY=FOLDER@UP,FRONT, got {place!r}")
    category, path, up, front = told.groups()
    if category is not None and category not in categories:
        known = f"those known are {', '.join(categories)}" if categories else "none is expected here"
        raise ValueError(f"{place!r} names category {category!r}; {known}")
    return category, Path(path), *stand_of(",".join(filter(None, (up or "y", front))), repr(place))


def stand_of(words: str, place: str) -> tuple[str, str]:
    """Read ``UP`` or ``UP,FRONT``: the axes of a file that point up and to the front.

    Args:
        words: to read.
        place: file or folder that states them, for messages.

    Raises:
        ValueError: for something else.
    """
    up, _, front = words.partition(",")
    for name, axis in (("up", up), ("the front", front or _FRONTS.get(up, "x"))):
        if axis not in AXES:
            raise ValueError(f"{place} says that {axis!r} is {name}; known are {', '.join(AXES)}")
    front = front or _FRONTS[up]
    if up[-1] == front[-1]:
        raise ValueError(f"{place} says that {up!r} is up and {front!r} the front; they must be different axes")
    return up, front
