"""Scanned objects to measure a model on: which category each is of, which way is up, and views of them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from kfit.bench.held_out_views import HeldOutViews, views_of
from kfit.bench.view_cameras import ViewsOf
from kfit.data import Light, Mesh
from kfit.data.exposure import with_exposure
from kfit.data.mesh_files import find_meshes, load_mesh
from kfit.geometry import CATEGORIES
from kfit.pose.category_model import CategoryModel

# The shortest turn that brings each axis up, to +y: what it makes of x, y and z. Opposite to y, it is one about x.
_TURNS: dict[str, list[list[int]]] = {
    "x": [[0, -1, 0], [1, 0, 0], [0, 0, 1]],
    "-x": [[0, 1, 0], [-1, 0, 0], [0, 0, 1]],
    "y": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "-y": [[1, 0, 0], [0, -1, 0], [0, 0, -1]],
    "z": [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
    "-z": [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
}


@dataclass(frozen=True)
class Scan:
    """A mesh file of a known category.

    Attributes:
        path: Path of the file.
        category: One of `kfit.geometry.CATEGORIES`.
        up: Axis of the file that points up: ``"z"`` for most scanners, ``"y"``, ``"-y"`` and so on.
    """

    path: Path
    category: str
    up: str = "z"

    @property
    def name(self) -> str:
        """Name of the object: the folder's name, or the file's if its folder holds several meshes."""
        alone = len(find_meshes(self.path.parent)) == 1
        return self.path.parent.name if alone else self.path.stem

    def mesh(self) -> Mesh:
        """Load the object with y up, its box centred at the origin, a diagonal of 1 and its exposure baked.

        The shortest rotation makes y point up; it preserves +x if z or −y pointed up. The handle of a mug, the lens of
        a camera and the screen of a laptop must point towards +x.

        Raises:
            FileNotFoundError, ValueError: As raised by `kfit.data.mesh_files.load_mesh`.
        """
        turn = np.eye(4)
        turn[:3, :3] = _TURNS[self.up]
        return with_exposure(load_mesh(self.path).transformed(turn).normalised(), two_sided=None)


def find_scans(places: Sequence[str]) -> tuple[list[Scan], list[Path]]:
    """Find scans below folders, and meshes whose category is unknown.

    A mesh gets the category that its file name or the innermost of its folder names contains as a complete word
    (``ycb/025_mug/textured.obj``: mug). If a mesh is found twice, an explicitly stated category wins.

    Args:
        places: ``FOLDER``, or ``CATEGORY=FOLDER`` if the names do not contain the category; append ``@y`` or another
            axis if z is not up.

    Raises:
        FileNotFoundError, ValueError: If a place has another form or holds no mesh.
    """
    assigned, guessed, unknown = {}, {}, []
    for place in places:
        folder, up = place, "z"
        category, equals, rest = place.partition("=")
        if equals and category in CATEGORIES:
            folder = rest
        elif equals and not Path(place).exists():
            raise ValueError(f"{place!r} names category {category!r}; those known are {', '.join(CATEGORIES)}")
        else:
            category = ""
        before, at, axis = folder.rpartition("@")
        if at and axis in _TURNS:
            folder, up = before, axis
        elif at and not Path(folder).exists():
            raise ValueError(f"{place!r} says that {axis!r} is up; known are {', '.join(_TURNS)}")
        for path in find_meshes(folder):
            file, named = path.resolve(), _named(path.relative_to(Path(folder).parent))
            if category:
                assigned[file] = Scan(path, category, up)
            elif named:
                guessed[file] = Scan(path, named, up)
            else:
                unknown.append(path)
    scans = guessed | assigned  # a stated category takes precedence over one found in a name
    return list(scans.values()), [path for path in unknown if path.resolve() not in assigned]


def _named(path: Path) -> str | None:
    for part in (path.stem, *reversed(path.parent.parts)):
        words = re.split("[^a-z]+", part.lower())
        found = [name for name in CATEGORIES if name in words]
        if found:
            return found[0]
    return None


def scan_views(
    model: CategoryModel, scan: Scan, num_views: int, seed: int = 0, kind: ViewsOf = "upright"
) -> HeldOutViews:
    """Draw views of one scan with `kfit.bench.held_out_views.views_of`, each in another random light."""
    mesh = scan.mesh()
    lights = (Light.random(np.random.default_rng([seed, number, 1])) for number in range(num_views))
    return views_of(model, ((mesh, light) for light in lights), seed, kind=kind)
