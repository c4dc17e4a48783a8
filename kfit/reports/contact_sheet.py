"""Fits of many views on one sheet: photo, mask, fitted drawing, and the pose on the photo."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from kfit.geometry import Crop
from kfit.reports.lettering import Picture
from kfit.reports.overlay import draw_overlay

# Side of a panel, space between cells and lines of text, in pixels.
PANEL, GAP, LINE = 176, 14, 26
# An overlay is drawn larger, so that its lines come out fine, and of more than the crop: boxes reach beyond it. Its
# border, where `draw_overlay` writes what it shows, is cut off.
DRAWN, BORDER, WIDER = 640, 44, 1.3
HEADINGS = ("photo", "mask", "fitted", "pose")
INK, GREY = (30, 30, 30), (120, 120, 120)


@dataclass(frozen=True)
class SheetEntry:
    """A fit to be shown.

    Attributes:
        image: (H, W, 3) array, RGB in [0, 1].
        mask: (H, W), 1 on the object.
        crop: the square that was fitted.
        drawing: (S, S, 3), the generator's picture of the crop.
        rotation, translation, size, intrinsics: as `kfit.reports.draw_overlay` takes them.
        caption: a line: its errors.
    """

    image: NDArray[Any]
    mask: NDArray[Any]
    crop: Crop
    drawing: NDArray[Any]
    rotation: Tensor
    translation: Tensor
    size: Tensor
    intrinsics: Tensor
    caption: str


def contact_sheet(entries: Sequence[SheetEntry], title: str, num_columns: int = 2) -> Picture:
    """Draw a sheet: a cell an entry, in the order given, down the columns.

    Args:
        entries: entries to show.
        title: a line above it all.
        num_columns: number of cells in a row.

    Returns:
        (height, width, 3) RGB bytes.

    Raises:
        ValueError: if there are no entries.
    """
    if not entries:
        raise ValueError("entries must hold at least one fit, got none")
    num_rows = -(-len(entries) // num_columns)
    num_columns = -(-len(entries) // num_rows)
    wide, high = 4 * PANEL + 3 * 2 + GAP, PANEL + LINE + GAP
    top = 3 * LINE
    sheet = np.full((top + num_rows * high, GAP + num_columns * wide, 3), 255, np.uint8)
    put_text(sheet, title, GAP, round(0.9 * LINE), INK, 0.75)
    for column in range(num_columns):
        for k, heading in enumerate(HEADINGS):
            put_text(sheet, heading, GAP + column * wide + k * (PANEL + 2), top - 8, GREY, 0.5)
    for number, entry in enumerate(entries):
        column, row = divmod(number, num_rows)
        left, upper = GAP + column * wide, top + row * high
        for k, panel in enumerate(_panels(entry)):
            x = left + k * (PANEL + 2)
            sheet[upper : upper + PANEL, x : x + PANEL] = panel
            cv2.rectangle(sheet, (x, upper), (x + PANEL - 1, upper + PANEL - 1), (215, 215, 215), 1)
        put_text(sheet, entry.caption, left, upper + PANEL + 18, INK, 0.5)
    return sheet


def evenly(errors: Sequence[float], number: int) -> list[int]:
    """Which of them to show: rows of ``number`` errors at most, from the least to the greatest in even steps of rank.

    Those that are not finite are left out.
    """
    order = sorted((k for k, error in enumerate(errors) if math.isfinite(error)), key=lambda k: errors[k])
    number = min(number, len(order))
    return [order[round(k * (len(order) - 1) / max(1, number - 1))] for k in range(number)]


def _panels(entry: SheetEntry) -> list[Picture]:
    image = np.asarray(entry.image, np.float32)
    mask = np.asarray(entry.mask, np.float32)
    near = Crop(entry.crop.centre, entry.crop.side, PANEL)
    photo = _window(image, near, 1.0)
    covered = _window(mask, near, 0.0)[..., None]
    drawing = cv2.resize(np.asarray(entry.drawing, np.float32), (PANEL, PANEL), interpolation=cv2.INTER_CUBIC)
    # Outside the mask the photo is dimmed, so that one sees what was taken for the object.
    dimmed = photo * covered + (0.25 * photo + 0.1) * (1 - covered)
    return [*(_bytes(picture) for picture in (photo, dimmed, drawing)), _pose(entry, image, mask)]


def _pose(entry: SheetEntry, image: NDArray[np.float32], mask: NDArray[np.float32]) -> Picture:
    inner = DRAWN - 2 * BORDER
    wide = Crop(entry.crop.centre, WIDER * entry.crop.side * DRAWN / inner, DRAWN)
    photo = _window(image, wide, 1.0)
    camera = wide.image_to_crop @ entry.intrinsics.double()
    try:
        drawn = draw_overlay(
            torch.from_numpy(photo).clamp(0, 1),
            entry.rotation,
            entry.translation,
            entry.size,
            camera,
            mask=_window(mask, wide, 0.0),
        )
    except ValueError:  # the box reaches behind the camera: such a fit is shown without it
        drawn = _bytes(photo)
    middle = drawn[BORDER : BORDER + inner, BORDER : BORDER + inner]
    small: Picture = cv2.resize(middle, (PANEL, PANEL), interpolation=cv2.INTER_AREA)
    return small


def _window(picture: NDArray[np.float32], crop: Crop, beyond: float) -> NDArray[np.float32]:
    """The part of a photo that a crop shows; ``beyond`` where the photo ends."""
    to_crop = crop.image_to_crop[:2].numpy()
    border = (beyond,) * 3
    # A warp samples points, so pictures that become smaller are averaged over pixels first.
    blur = crop.side / crop.size / 2
    soft = cv2.GaussianBlur(picture, (0, 0), blur) if blur > 0.5 else picture
    shown: NDArray[np.float32] = cv2.warpAffine(
        soft, to_crop, (crop.size, crop.size), flags=cv2.INTER_LINEAR, borderValue=border
    )
    return shown


def _bytes(picture: NDArray[np.float32]) -> Picture:
    return np.ascontiguousarray((picture.clip(0, 1) * 255).round().astype(np.uint8))


def put_text(sheet: Picture, text: str, left: int, base: int, ink: tuple[int, int, int], scale: float) -> None:
    """Write a line of Latin text onto a picture, from its lower left corner."""
    cv2.putText(sheet, text, (left, base), cv2.FONT_HERSHEY_SIMPLEX, scale, ink, 1, cv2.LINE_AA)
