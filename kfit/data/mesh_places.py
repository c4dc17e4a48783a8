"""Places and orientations of mesh files, in the syntax of ``--data.meshes`` and of every command's ``--meshes``."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kfit.core.check import check_text
from kfit.data.mesh import Mesh
from kfit.data.mesh_files import find_meshes, load_mesh, meshes_of
from kfit.data.mesh_tree import mesh_identities
from kfit.geometry import Category

AXES = {"x": (1, 0, 0), "-x": (-1, 0, 0), "y": (0, 1, 0), "-y": (0, -1, 0), "z": (0, 0, 1), "-z": (0, 0, -1)}
# Default front: the axis that the shortest rotation moves to +x once the up axis points along +y.
_FRONTS = {"y": "x", "-y": "x", "z": "x", "-z": "x", "x": "-y", "-x": "y"}
_PLACE = re.compile(r"(?:([A-Za-z][\w-]*)=)?(.+?)(?:@([^@/,]+)(?:,([^@/,]+))?)?")


@dataclass(frozen=True)
class MeshFile:
    """A mesh file, and the orientation of its object.

    Attributes:
        path: path of the file.
        category: category of the object; None if unknown.
        up: axis of the file that points up, such as ``"y"`` or ``"-z"``.
        front: axis of the file that becomes +x, the category's front; by default the axis that the shortest rotation
            moves there.
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
        """Name of the object: the folder's name, or the file's if its folder holds several meshes."""
        alone = len(meshes_of(self.path.parent)) == 1
        return self.path.parent.name if alone else self.path.stem

    @property
    def rotation(self) -> NDArray[np.float64]:
        """Rotation (3, 3) from the file's axes to the category's: up to +y, front to +x."""
        up, front = (np.array(AXES[axis], float) for axis in (self.up, self.front))
        return np.stack([front, up, np.cross(front, up)])

    def mesh(self) -> Mesh:
        """Load the object with y up, its front towards +x, its box centred at the origin and a diagonal of 1.

        Raises:
            FileNotFoundError, ValueError: As raised by `kfit.data.mesh_files.load_mesh`.
        """
        turn = np.eye(4)
        turn[:3, :3] = self.rotation
        return load_mesh(self.path).transformed(turn).normalised()


def find_mesh_files(places: str | Sequence[str], categories: Collection[str] = ()) -> list[MeshFile]:
    """Find mesh files in places, which also state their orientation, sorted by path within a place.

    Args:
        places: ``FOLDER`` or ``FILE``, one or several, optionally with a prefix ``CATEGORY=`` and a suffix ``@UP`` or
            ``@UP,FRONT``: axes of the file such as ``@z`` or, for ShapeNet, ``@y,-z``. By default y is up and the front
            is +x. If several places hold a file, the last orientation and the last category stated apply.
        categories: names that are allowed as prefixes.

    Raises:
        FileNotFoundError, ValueError: If a place has another form or holds no mesh.
    """
    found: dict[Path, MeshFile] = {}
    for place in [places] if isinstance(places, str) else places:
        category, path, up, front = _parts(place, categories)
        if not path.exists():
            raise FileNotFoundError(f"meshes must name files or folders of meshes, but there is no {path}")
        for file in [path] if path.is_file() else find_meshes(path):
            before = found.pop(file.resolve(), None)
            kept = category if category is not None or before is None else before.category
            if before is not None and "@" not in place:
                up, front = before.up, before.front
            found[file.resolve()] = MeshFile(file, kept, up, front)
    return list(found.values())


def check_mesh_file(name: str, file: object) -> None:
    """Check that ``file`` is a path or a mesh file.

    Raises:
        TypeError: If it is neither; the message names the argument.
    """
    check_text(name, file.path if isinstance(file, MeshFile) else file)


def as_mesh_file(file: str | Path | MeshFile) -> MeshFile:
    """Convert a path to a mesh file with y up and its front towards +x."""
    return file if isinstance(file, MeshFile) else MeshFile(Path(file))


def source_identity(source: str | Category | Sequence[MeshFile]) -> str | list[str]:
    """Identify a source of objects: by a category's name, or by names, contents and axes of mesh files."""
    if isinstance(source, str | Category):
        return source if isinstance(source, str) else source.name
    contents = mesh_identities([file.path for file in source])
    axes = ["" if (file.up, file.front) == ("y", "x") else f" @{file.up},{file.front}" for file in source]
    return [content + stands for content, stands in zip(contents, axes, strict=True)]


def _parts(place: str, categories: Collection[str]) -> tuple[str | None, Path, str, str]:
    """Category, path, up and front of a place."""
    if Path(place).exists():  # even if its name holds = or @
        return None, Path(place), "y", "x"
    match = _PLACE.fullmatch(place)
    if match is None:
        raise ValueError(f"a place of meshes must be FOLDER, FOLDER@UP or CATEGORY=FOLDER@UP,FRONT, got {place!r}")
    category, path, up, front = match.groups()
    if category is not None and category not in categories:
        known = f"those known are {', '.join(categories)}" if categories else "none is expected here"
        raise ValueError(f"{place!r} names category {category!r}; {known}")
    return category, Path(path), *stand_of(",".join(filter(None, (up or "y", front))), repr(place))


def stand_of(words: str, place: str) -> tuple[str, str]:
    """Read ``UP`` or ``UP,FRONT``: the axes of a file that point up and to the front.

    Args:
        words: text to read.
        place: file or folder that states them, for messages.

    Raises:
        ValueError: If the text has another form.
    """
    up, _, front = words.partition(",")
    for name, axis in (("up", up), ("the front", front or _FRONTS.get(up, "x"))):
        if axis not in AXES:
            raise ValueError(f"{place} says that {axis!r} is {name}; known are {', '.join(AXES)}")
    front = front or _FRONTS[up]
    if up[-1] == front[-1]:
        raise ValueError(f"{place} says that {up!r} is up and {front!r} the front; they must be different axes")
    return up, front
