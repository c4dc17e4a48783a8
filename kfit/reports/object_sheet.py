"""Objects as training draws them, from sides that show whether they stand as their category does."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from kfit.data import Light, Mesh, pose_view
from kfit.reports.contact_sheet import GAP, GREY, INK, LINE, PANEL, put_text
from kfit.reports.lettering import Picture

# Azimuth and elevation in degrees, by what they must show. At azimuth −90° an object's +x points towards the viewer.
SIDES = {
    "front (+x) to you": (-90.0, 10.0),
    "front to the right": (0.0, 10.0),
    "front to the left": (180.0, 10.0),
    "from above, front to you": (-90.0, 70.0),
}


def object_sheet(objects: Iterable[tuple[str, Mesh, Light]], title: str) -> Picture:
    """Draw a sheet with a row for each object, from four sides.

    Args:
        objects: a name and a normalised mesh each, with its light.
        title: a line above them.

    Returns:
        (height, width, 3) RGB bytes.

    Raises:
        ValueError: if there are no objects.
    """
    rows = []
    wide, high = len(SIDES) * (PANEL + GAP) + GAP, PANEL + LINE
    for name, mesh, light in objects:
        row = np.full((high, wide, 3), 255, np.uint8)
        for k, (azimuth, elevation) in enumerate(SIDES.values()):
            view = pose_view(mesh, math.radians(elevation), math.radians(azimuth), light, PANEL)
            left = GAP + k * (PANEL + GAP)
            row[:PANEL, left : left + PANEL] = (255 * view.image + 0.5).astype(np.uint8)
        put_text(row, name, GAP, PANEL + 16, INK, 0.45)
        rows.append(row)
    if not rows:
        raise ValueError("objects must hold at least one object, got none")
    head = np.full((2 * LINE + GAP, wide, 3), 255, np.uint8)
    put_text(head, title, GAP, round(0.9 * LINE), INK, 0.6)
    for k, side in enumerate(SIDES):
        put_text(head, side, GAP + k * (PANEL + GAP), 2 * LINE, GREY, 0.42)
    sheet: Picture = np.concatenate([head, *rows])
    return sheet
