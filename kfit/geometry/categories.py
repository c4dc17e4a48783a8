"""What a kind of object is: symmetry, mean size, valid poses and shape, as plain data; kfit's own are NOCS's six."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

from kfit.core.arguments import check_arguments
from kfit.core.check import check_names, check_rising
from kfit.geometry.symmetry import Symmetry, check_symmetry, num_turns

# A diagonal is taken to lie within this factor of the mean where a category has no range.
SIZE_FACTOR = 3.0
_NAME = re.compile(r"[A-Za-z][\w-]{0,39}")


@dataclass(frozen=True)
class Category:
    """A category of objects.

    Args:
        name: one word; the six categories of NOCS have the same names as there.
        mean_diagonal: mean length of the bounding box's diagonal in metres. Distances from colour alone depend on it.
        symmetry: ``"none"``; ``"y"`` where the object looks the same turned freely about its vertical axis; ``"y2"`` to
            ``"y12"`` where it looks the same turned by a half, a third … of a circle about it.
        diagonals: smallest and largest diagonal of real objects, in metres; a third and three times the mean if None.
        unit_fraction: share of the width of training pictures that a unit diagonal spans, 0.1 to 10; as large as leaves
            the category's widest outlines inside.
        sides: sides of a box that holds every object of the category, along its axes, in diagonals of the object, at
            most 1.
        axes: orientation of the object in its frame, in words; y points up.
        elevation_deg: range of elevations at which photos show standing objects, −90 to 90.
        upright: share of views that show the object standing, 0 to 1; the others show it from all directions. Training
            draws views so, and a `kfit.generators.RotationHead` has it as a prior.
        mirror: whether the mirror image in the plane of its x and y axes is an object of the category too. Training
            then flips half of the pictures.
        shapes: import path of a module with ``build(rng, held_out)``, which draws one object as a `kfit.data.Mesh`;
            None where objects come from mesh files alone.
        nocs_id: class number in NOCS's files; None outside of them.
        front: the part that points along +x, used in messages; None if there is none.

    Raises:
        TypeError, ValueError: If a field is invalid; the message names it.

    Example:
        >>> from kfit.geometry import CATEGORIES, Category
        >>> mug, vase = CATEGORIES["mug"], Category("vase", mean_diagonal=0.3, symmetry="y")
        >>> mug.axes, mug.azimuth_deg, vase.azimuth_deg
        ('y up, handle towards +x', (-180.0, 180.0), (0.0, 0.0))
    """

    name: str
    mean_diagonal: float
    symmetry: Symmetry = "none"
    diagonals: tuple[float, float] | None = None
    unit_fraction: float = 1.0
    sides: tuple[float, float, float] = (1.0, 1.0, 1.0)
    axes: str = "y up"
    elevation_deg: tuple[float, float] = (-15.0, 75.0)
    upright: float = 0.5
    mirror: bool = True
    shapes: str | None = None
    nocs_id: int | None = None
    front: str | None = None

    def __post_init__(self) -> None:
        check_arguments(
            Category,
            vars(self),
            symmetry=(check_symmetry,),
            mean_diagonal=(1e-4, 1e4),
            diagonals=(check_rising, 1e-5, 1e5),
            unit_fraction=(0.1, 10),
            sides=(0.01, 1),
            elevation_deg=(check_rising, -90, 90),
            upright=(0, 1),
            nocs_id=(0, 10**6),
        )
        if not _NAME.fullmatch(self.name):
            raise ValueError(f"Category: name must be a word of letters, digits, - and _, got {self.name!r}")
        for name in ("diagonals", "sides", "elevation_deg"):  # lists of YAML and JSON
            if (numbers := getattr(self, name)) is not None:
                object.__setattr__(self, name, tuple(float(number) for number in numbers))

    @staticmethod
    def of_dict(values: Mapping[str, Any]) -> Category:
        """Read a category from plain values by the names of its fields.

        Raises:
            TypeError, ValueError: for unknown fields, missing ones, and values that a field does not take.
        """
        check_names("category", values, [field.name for field in fields(Category)])
        if missing := sorted({"name", "mean_diagonal"} - set(values)):
            raise ValueError(f"category: nothing for {', '.join(missing)}")
        return Category(**values)

    def to_dict(self) -> dict[str, Any]:
        """Give the fields as plain values, which `of_dict` reads."""
        return {name: list(value) if isinstance(value, tuple) else value for name, value in asdict(self).items()}

    @property
    def azimuth_deg(self) -> tuple[float, float]:
        """Range of azimuths that are different poses, the full circle, or one value where all are alike."""
        turns = num_turns(self.symmetry)
        return (-180.0 / turns, 180.0 / turns) if turns else (0.0, 0.0)

    @property
    def size_range(self) -> tuple[float, float]:
        """Least and largest diagonal in metres."""
        return self.diagonals or (self.mean_diagonal / SIZE_FACTOR, self.mean_diagonal * SIZE_FACTOR)


# Mean diagonals are those over NOCS's CAMERA training set (constants of the released code,
# neural_object_fitting@7309348 eval.py).
_Y = "y up, free to turn about y"
_DRAWN = "kfit.data.shapes."
CATEGORIES: dict[str, Category] = {
    category.name: category
    for category in (
        Category("bottle", 0.34, "y", (0.1, 0.6), 1.0, (0.52, 1.0, 0.52), axes=_Y, shapes=_DRAWN + "bottle", nocs_id=1),
        Category("bowl", 0.21, "y", (0.08, 0.5), 1.25, (0.76, 0.55, 0.76), axes=_Y, shapes=_DRAWN + "bowl", nocs_id=2),
        Category(
            "camera",
            *(0.19, "none", (0.07, 0.5), 1.0, (0.85, 0.8, 0.88)),
            axes="y up, lens towards +x",
            shapes=_DRAWN + "camera",
            nocs_id=3,
            front="lens",
        ),
        Category("can", 0.15, "y", (0.06, 0.35), 1.03, (0.75, 0.97, 0.75), axes=_Y, shapes=_DRAWN + "can", nocs_id=4),
        Category(
            "laptop",
            *(0.46, "none", (0.22, 0.8), 1.0, (0.86, 0.65, 0.86)),
            axes="y up, screen facing +x",
            shapes=_DRAWN + "laptop",
            nocs_id=5,
            front="screen",
        ),
        Category(
            "mug",
            *(0.17, "none", (0.07, 0.35), 1.15, (0.87, 0.75, 0.67)),
            axes="y up, handle towards +x",
            shapes=_DRAWN + "mug",
            nocs_id=6,
            front="handle",
        ),
    )
}
"""NOCS's six categories."""
