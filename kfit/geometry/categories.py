"""Constants of each NOCS category: symmetry, mean size and valid poses."""

from __future__ import annotations

from dataclasses import dataclass

from kfit.geometry.pose import Symmetry


@dataclass(frozen=True)
class Category:
    """A category of objects.

    Attributes:
        name: as NOCS spells it.
        nocs_id: class number in NOCS's files.
        symmetry: ``"none"``, or ``"y"`` for rotational symmetry about the vertical axis.
        mean_diagonal: mean length of the bounding box's diagonal in metres, over NOCS's CAMERA training set
            (constants of the released code, neural_object_fitting@7309348 eval.py).
        diagonals: least and largest diagonal in metres of real objects, such as an espresso cup and a litre mug.
        unit_fraction: fraction of the width of kfit's training pictures that a unit diagonal spans, as large as the
            category's widest outlines allow.
        sides: sides of a box that holds every object of the category, along NOCS's axes, in diagonals of the object.
        axes: orientation of the object in NOCS's frame; y points up.
        elevation_deg: range of elevations in photos.
        front: the part that points along +x, for sentences; None where nothing does.

    Example:
        >>> from kfit.geometry import CATEGORIES
        >>> mug = CATEGORIES["mug"]
        >>> mug.axes, mug.mean_diagonal, mug.azimuth_deg
        ('y up, handle towards +x', 0.17, (-180.0, 180.0))
    """

    name: str
    nocs_id: int
    symmetry: Symmetry
    mean_diagonal: float
    diagonals: tuple[float, float]
    unit_fraction: float
    sides: tuple[float, float, float]
    axes: str
    elevation_deg: tuple[float, float] = (-15.0, 75.0)
    front: str | None = None

    @property
    def azimuth_deg(self) -> tuple[float, float]:
        """Range of distinguishable azimuths: the full circle, or one value with rotational symmetry."""
        return (0.0, 0.0) if self.symmetry == "y" else (-180.0, 180.0)


CATEGORIES: dict[str, Category] = {
    category.name: category
    for category in (
        Category("bottle", 1, "y", 0.34, (0.1, 0.6), 1.0, (0.52, 1.0, 0.52), "y up, free to turn about y"),
        Category("bowl", 2, "y", 0.21, (0.08, 0.5), 1.25, (0.76, 0.55, 0.76), "y up, free to turn about y"),
        Category("camera", 3, "none", 0.19, (0.07, 0.5), 1.0, (0.85, 0.8, 0.88), "y up, lens towards +x", front="lens"),
        Category("can", 4, "y", 0.15, (0.06, 0.35), 1.03, (0.75, 0.97, 0.75), "y up, free to turn about y"),
        Category(
            "laptop", 5, "none", 0.46, (0.22, 0.8), 1.0, (0.86, 0.65, 0.86), "y up, screen facing +x", front="screen"
        ),
        Category(
            "mug", 6, "none", 0.17, (0.07, 0.35), 1.15, (0.87, 0.75, 0.67), "y up, handle towards +x", front="handle"
        ),
    )
}
