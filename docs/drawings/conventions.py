"""Draws the page on conventions with kfit's own geometry: python docs/drawings/conventions.py [FOLDER]."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import torch
from matplotlib.figure import Figure
from numpy.typing import NDArray
from skimage import data
from skimage.io import imread

from kfit.data import build, pose_view
from kfit.data.rasterizer import standard_intrinsics, standard_pose
from kfit.geometry import Crop, rotation_from_angles, to_opencv

HERE = Path(__file__).parent
INK, PALE, PAPER = "#2b2f36", "#aab1bd", "#fcfcfd"
RED, GREEN, BLUE, ORANGE = "#d43d51", "#1f9254", "#2f6fde", "#d9730d"
SIZE = 320
MUG, LIGHT = build("mug", 5)


def figure(width: float, height: float, left: float, right: float, low: float, high: float) -> tuple[Figure, Any]:
    """A sheet of these inches, whose one plane has these limits and even units."""
    sheet = Figure((width, height), facecolor=PAPER)
    axes = sheet.add_axes((0, 0, 1, 1), facecolor=PAPER)
    axes.set(xlim=(left, right), ylim=(low, high), aspect="equal")
    axes.axis("off")
    return sheet, axes


def arrow(axes: Any, start: Any, end: Any, color: str, label: str = "", away: float = 0.08, **style: Any) -> None:
    """An arrow with its name behind its tip."""
    start, end = np.asarray(start, float), np.asarray(end, float)
    axes.annotate("", end, start, arrowprops={"arrowstyle": "-|>", "color": color, "lw": 2.2, "shrinkA": 0, **style})
    along = (end - start) / max(np.linalg.norm(end - start), 1e-6)
    axes.text(*(end + away * along), label, color=color, ha="center", va="center", size=13, weight="bold")


def mug(azimuth_deg: float, elevation_deg: float, size: int = SIZE) -> NDArray[Any]:
    """A mug on paper, seen so."""
    view = pose_view(MUG, math.radians(elevation_deg), math.radians(azimuth_deg), LIGHT, size)
    mask = view.mask[..., None]
    seen: NDArray[Any] = view.image * mask + np.array(mpl.colors.to_rgb(PAPER)) * (1 - mask)
    return seen


def object_axes() -> Figure:
    """NOCS's axes in a mug and its box."""
    azimuth, elevation = math.radians(-35), math.radians(28)
    sheet, axes = figure(4.4, 3.9, -15, 365, 315, -22)
    axes.imshow(mug(-35, 28), extent=(-0.5, SIZE - 0.5, SIZE - 0.5, -0.5), interpolation="bilinear")
    world, lens = standard_pose(elevation, azimuth), standard_intrinsics(SIZE)

    def place(points: Any) -> NDArray[Any]:
        seen = np.atleast_2d(points) @ world[:3, :3].T + world[:3, 3]
        x, y = seen[:, 0] / -seen[:, 2], seen[:, 1] / -seen[:, 2]
        return np.stack([lens[0, 0] * x + lens[0, 2], -lens[1, 1] * y + lens[1, 2]], 1)

    sides = np.ptp(MUG.vertices, axis=0)
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * sides / 2
    for one in range(8):
        for other in range(one):
            if np.count_nonzero(corners[one] != corners[other]) == 1:
                axes.plot(*place(corners[[one, other]]).T, color=PALE, lw=1.2, zorder=0 if min(one, other) else 3)
    middle = place([0, 0, 0])[0]
    for direction, color, name in (((0.66, 0, 0), RED, "x"), ((0, 0.5, 0), GREEN, "y"), ((0, 0, 0.62), BLUE, "z")):
        arrow(axes, middle, place(direction)[0], color, name, 11)
    axes.text(332, 176, "to the", color=RED, ha="center", size=11)
    axes.text(332, 192, "handle", color=RED, ha="center", size=11)
    axes.text(middle[0] + 10, 9, "up", color=GREEN, size=11)
    return sheet


def generator_frame() -> Figure:
    """The picture that a generator draws, and what moves in it."""
    sheet, axes = figure(4.4, 4.0, -1.35, 1.65, -1.35, 1.38)
    axes.imshow(mug(0, 28), extent=(-1, 1, -1, 1), interpolation="bilinear")
    axes.plot([-1, 1, 1, -1, -1], [-1, -1, 1, 1, -1], color=INK, lw=1.2)
    arrow(axes, (0, 0), (1.22, 0), RED, "x", 0.1)
    arrow(axes, (0, 0), (0, 1.16), GREEN, "y", 0.1)
    axes.plot(0, 0, "o", ms=13, mfc=PAPER, mec=BLUE, mew=2)
    axes.plot(0, 0, "o", ms=4, color=BLUE)
    axes.text(-0.13, -0.17, "z", color=BLUE, size=13, weight="bold", ha="center")
    axes.text(1.38, -0.2, "right", color=RED, size=11, ha="center")
    axes.text(0.1, 1.13, "up", color=GREEN, size=11)
    axes.text(-0.98, -0.93, "z: towards the viewer", color=BLUE, size=11)
    axes.annotate("", (0.62, 0.78), (0.92, 0.42), arrowprops={"arrowstyle": "-|>", "color": ORANGE, "lw": 2,
                  "connectionstyle": "arc3,rad=0.3"})  # fmt: skip
    axes.text(0.84, 0.72, "roll", color=ORANGE, size=11, ha="center")
    for x, text in ((-1, "−1"), (0, "0"), (1, "1")):
        axes.text(x, -1.13, text, color=INK, size=10, ha="center", va="center")
    axes.text(0, -1.27, "shift: in half-widths of the picture", color=INK, size=10, ha="center", va="center")
    return sheet


def camera_frame() -> Figure:
    """OpenCV's camera, its picture and an object before it."""
    sheet, axes = figure(4.4, 3.4, -0.6, 5.15, -1.75, 2.7)

    def place(points: Any) -> NDArray[Any]:  # looked at from behind, the right and above
        points = np.atleast_2d(np.asarray(points, float))
        return np.stack(
            [0.55 * points[:, 0] + 0.86 * points[:, 2], 0.34 * points[:, 2] - points[:, 1] - 0.3 * points[:, 0]], 1
        )

    frame = np.array([[x, y, 1.6] for x, y in ((-1, -0.75), (1, -0.75), (1, 0.75), (-1, 0.75))])
    axes.fill(*place(frame).T, color="#e9edf5", ec=INK, lw=1.2, zorder=0)
    for corner in frame:
        axes.plot(*place([[0, 0, 0], corner]).T, color=PALE, lw=1, zorder=0)
    axes.text(*(place(frame[0])[0] + [0.1, 0.14]), "photo", color=INK, size=11, ha="center")
    home, centre = place([0, 0, 0])[0], np.array([0.25, 0.1, 3.9])
    turn = to_opencv(rotation_from_angles(*torch.tensor([0.5, 0.45, 0.0]))).numpy()
    sides = np.ptp(MUG.vertices, axis=0)
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * sides * 0.9
    seen = corners @ turn.T + centre
    for one in range(8):
        for other in range(one):
            if np.count_nonzero(corners[one] != corners[other]) == 1:
                axes.plot(*place(seen[[one, other]]).T, color=PALE, lw=1.3)
    arrow(axes, home, place(centre)[0], ORANGE, lw=1.8, linestyle="--")
    axes.text(*(place(0.6 * centre)[0] + [0.05, 0.24]), "t", color=ORANGE, size=13, weight="bold")
    for end, color, name in (((1.7, 0, 0), RED, "x"), ((0, 1.2, 0), GREEN, "y"), ((0, 0, 1.0), BLUE, "z")):
        arrow(axes, home, place(end)[0], color, name, 0.16)
    for direction, color, name in zip(turn.T, (RED, GREEN, BLUE), "xyz", strict=True):
        arrow(axes, place(centre)[0], place(centre + 1.2 * direction)[0], color, name, 0.14)
    axes.text(*(place([1.7, 0, 0])[0] + [0.28, -0.1]), "right", color=RED, size=11)
    axes.text(*(place([0, 1.2, 0])[0] + [0.14, -0.22]), "down", color=GREEN, size=11)
    axes.text(*(place([0, 0, 1.0])[0] + [0.24, -0.14]), "forward", color=BLUE, size=10)
    axes.text(home[0] - 0.1, home[1] + 0.2, "camera", color=INK, size=11, ha="center")
    return sheet


def angles() -> Figure:
    """What each angle does."""
    rows = (
        ("azimuth", (-90, -45, 0, 45, 90), lambda angle: mug(angle, 25, 200)),
        ("elevation", (-15, 0, 25, 50, 75), lambda angle: mug(-30, angle, 200)),
        ("roll", (-30, -15, 0, 15, 30), lambda angle: mug(-30, 25, 200)),
    )
    sheet, axes = figure(7.2, 5.1, -0.1, 5.3, -0.1, 3.72)
    for below, (name, steps, drawn) in enumerate(rows):
        bottom = 2.48 - 1.26 * below
        axes.text(0.05, bottom + 1.06, name, color=INK, size=13, weight="bold")
        for column, step in enumerate(steps):
            extent = (1.05 * column, 1.05 * column + 1, bottom, bottom + 1)
            picture = axes.imshow(drawn(step), extent=extent, interpolation="bilinear")
            if name == "roll":
                middle = (1.05 * column + 0.5, bottom + 0.5)
                picture.set_transform(mpl.transforms.Affine2D().rotate_deg_around(*middle, step) + axes.transData)
                picture.set_zorder(-1)
            axes.text(1.05 * column + 0.5, bottom - 0.04, f"{step}°".replace("-", "−"), color=INK, size=11, ha="center")
    return sheet


def crop() -> Figure:
    """From a photo to what a fit explains."""
    photo = data.coffee() / 255
    mask = imread(HERE.parents[1] / "examples" / "coffee_mask.png") > 0
    cut = Crop.around(mask)
    seen = cut.cut(photo, mask).image[0].movedim(0, -1).numpy()
    sheet, axes = figure(7.2, 3.6, -10, 1010, 445, -65)
    axes.imshow(photo[::2, ::2], extent=(0, 600, 400, 0), interpolation="bilinear")
    axes.contour(mask, [0.5], colors=[GREEN], linewidths=1.6)
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    left, right, top, low = columns[0], columns[-1], rows[0], rows[-1]
    axes.plot([left, right, right, left, left], [top, top, low, low, top], color="white", lw=1.4, ls="--")
    (x, y), half = cut.centre, cut.side / 2
    square = np.array([(x - half, y - half), (x + half, y - half), (x + half, y + half), (x - half, y + half)])
    axes.plot(*np.vstack([square, square[:1]]).T, color=ORANGE, lw=2.2, clip_on=False)
    axes.imshow(seen, extent=(700, 1000, 350, 50), interpolation="nearest")
    axes.plot([700, 1000, 1000, 700, 700], [50, 50, 350, 350, 50], color=ORANGE, lw=2.2)
    arrow(axes, (612, 200), (690, 200), INK)
    axes.text(0, 424, "photo, mask, its box, the crop of 1.3 times its longer side", color=INK, size=10, va="center")
    axes.text(850, 376, "what a fit explains: 64 × 64,", color=INK, size=10, ha="center", va="center")
    axes.text(850, 402, "the object on white", color=INK, size=10, ha="center", va="center")
    axes.text(700, 36, "crop", color=ORANGE, size=11, weight="bold")
    return sheet


def main(folder: Path) -> None:
    """Draw all of them, the same bytes each time."""
    mpl.rcParams |= {"svg.hashsalt": "kfit", "font.family": "DejaVu Sans"}
    for drawn in (object_axes, generator_frame, camera_frame, angles, crop):
        sheet: Figure = drawn()
        title = str(drawn.__doc__)
        sheet.savefig(folder / f"{drawn.__name__}.svg", metadata={"Date": None, "Title": title}, facecolor=PAPER)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE.parent / "pictures")
