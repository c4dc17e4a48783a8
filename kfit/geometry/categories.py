"""What kfit knows about each NOCS category: symmetry, mean size and valid poses, declared once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Category:
    """A kind of object.

    Attributes:
        name: as NOCS spells it.
        nocs_id: class number in NOCS's files.
        symmetry: ``"none"``, or ``"y"`` where the object looks the same turned freely about its vertical axis.
        mean_diagonal: mean length of the bounding box's diagonal in metres, over NOCS's CAMERA training set
            (constants of the released code, neural_object_fitting@7309348 eval.py).
        elevation_deg: range of elevations that photos show.
    """

    name: str
    nocs_id: int
    symmetry: Literal["none", "y"]
    mean_diagonal: float
    elevation_deg: tuple[float, float] = (-15.0, 75.0)


CATEGORIES: dict[str, Category] = {
    category.name: category
    for category in (
        Category("bottle", 1, "y", 0.34),
        Category("bowl", 2, "y", 0.21),
        Category("camera", 3, "none", 0.19),
        Category("can", 4, "y", 0.15),
        Category("laptop", 5, "none", 0.46),
        Category("mug", 6, "none", 0.17),
    )
}
