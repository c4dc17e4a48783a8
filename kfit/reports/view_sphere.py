"""Where the camera sits around the object, by the answer and by its alternatives."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import torch
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray
from torch import Tensor

from kfit.geometry import EDGES, box_corners, rotation_from_angles
from kfit.pose import PoseResult
from kfit.reports.inline_svg import ACCENT, INK, MUTED, PAPER, inline_svg, styled
from kfit.reports.words import camera_angles, view_words

Points = NDArray[np.float64]

# Area in square points of a pose that has all the weight, and what one with hardly any is still given.
AREA, LEAST = 900.0, 30.0
SIDE, REACH = 4.6, 1.12  # of the picture, in inches and in radii of the sphere
LABELLED = 4  # poses at most, the heaviest
BOX, AXES = "#e09a00", (("x", "#e62828"), ("y", "#1eaa3c"), ("z", "#4a7dff"))


def view_sphere(result: PoseResult) -> Markup:
    """Draw the sphere of views as seen from outside, turned so that the answer is in front.

    A disc a pose, its area by its weight, the answer's in the colour of emphasis; hollow ones are on the far side. In
    the middle lie the object's box and axes. For an object that looks the same turned about y, circles are the views
    that differ by such a turn.
    """
    places = [camera_angles(found.rotation, result.translation)[:2] for found in result.alternatives]
    azimuth, above = places[0]
    # A camera at azimuth a sees the object rotated by a; this view is from the side of the answer's, and higher.
    onlooker = rotation_from_angles(
        *torch.tensor([azimuth + 30, min(max(above, 0) / 2 + 20, 60), 0]).double().deg2rad()
    )
    with styled():
        figure = Figure(figsize=(SIDE, SIDE))
        plot = figure.add_axes((0, 0, 1, 1))
        plot.set(xlim=(-REACH, REACH), ylim=(-REACH, REACH), aspect="equal")
        plot.axis("off")
        _globe(plot, onlooker)
        _object(plot, onlooker, torch.from_numpy(result.size))
        if result.symmetry == "y":
            for found, (_, elevation) in zip(result.alternatives, places, strict=True):
                colour = ACCENT if found is result.alternatives[0] else INK
                _circle(plot, onlooker, _around(elevation), colour, 1.6, 1.0, 0.35)
        _poses(plot, onlooker, places, [found.weight for found in result.alternatives])
        described = "; ".join(
            view_words(result.front, found.rotation, result.translation) + f", {100 * found.weight:.0f} % of the weight"
            for found in result.alternatives[:LABELLED]
        )
        return inline_svg(figure, f"Sphere of views about the object: {described}")


def _poses(plot: Axes, onlooker: Tensor, places: Sequence[tuple[float, float]], weights: Sequence[float]) -> None:
    projected = _projected(onlooker, torch.stack([_on_sphere(*place) for place in places]))
    plot.plot([0, projected[0, 0]], [0, projected[0, 1]], color=ACCENT, lw=1.2, ls=(0, (3, 3)))
    labelled = sorted(range(len(weights)), key=lambda k: -weights[k])[:LABELLED]
    for k in reversed(range(len(places))):
        x, y, near = projected[k]
        colour, area = ACCENT if k == 0 else INK, LEAST + AREA * weights[k]
        face, edge = (colour, PAPER) if near >= 0 else (PAPER, colour)
        # One that a larger one covers stays visible through it.
        plot.scatter(x, y, s=area, alpha=0.85, lw=1.6, zorder=5 + (near >= 0), facecolor=face, edgecolor=edge)
        if k == 0 or k in labelled:
            share = f"{100 * weights[k]:.0f} %" if len(weights) > 1 else ""
            name = ", ".join(filter(None, ["answer" if k == 0 else "", share]))
            away = math.sqrt(area / math.pi) / (36 * SIDE / REACH) + 0.03
            # Away from the middle, where the object and its axes are, and not over the rim.
            if abs(x) < 0.5:
                way, ha = (1, "left") if x >= 0 else (-1, "right")
                plot.text(x + way * away, y, name, color=colour, ha=ha, va="center", zorder=8)
            else:
                way, va = (1, "bottom") if y >= 0 else (-1, "top")
                plot.text(x, y + way * away, name, color=colour, ha="center", va=va, zorder=8)


def _globe(plot: Axes, onlooker: Tensor) -> None:
    rim = np.linspace(0, 2 * math.pi, 181)
    plot.fill(np.cos(rim), np.sin(rim), color=MUTED, alpha=0.07, lw=0)
    plot.plot(np.cos(rim), np.sin(rim), color=MUTED, lw=1)
    for elevation in (-60, -30, 0, 30, 60):
        _circle(plot, onlooker, _around(elevation), MUTED, 1.4 if elevation == 0 else 0.7, 0.7, 0.18)
    for azimuth in range(0, 360, 30):
        line = torch.stack([_on_sphere(azimuth, elevation) for elevation in range(-90, 91, 3)])
        _circle(plot, onlooker, line, MUTED, 0.7, 0.7, 0.18)


def _object(plot: Axes, onlooker: Tensor, size: Tensor) -> None:
    size = 0.62 * size / size.norm()
    corners = _projected(onlooker, box_corners(torch.eye(3).double(), torch.zeros(3).double(), size))
    edges = corners[np.array(EDGES)]
    far = (edges == corners[corners[:, 2].argmin()]).all(-1).any(1)
    plot.add_collection(LineCollection(list(edges[..., :2]), colors=BOX, lw=1.3, alpha=np.where(far, 0.35, 1.0)))
    tips = _projected(onlooker, 0.45 * torch.eye(3).double())
    for k in tips[:, 2].argsort():
        name, colour = AXES[k]
        plot.plot([0, tips[k, 0]], [0, tips[k, 1]], color=colour, lw=2)
        plot.text(1.18 * tips[k, 0], 1.18 * tips[k, 1], name, color=colour, ha="center", va="center", weight="bold")


def _circle(plot: Axes, onlooker: Tensor, line: Tensor, colour: str, width: float, strong: float, dim: float) -> None:
    """A line on the sphere, faint where it is on the far side."""
    projected = _projected(onlooker, line)
    pieces = np.stack([projected[:-1], projected[1:]], 1)
    alpha = np.where(pieces[..., 2].mean(1) >= 0, strong, dim)
    plot.add_collection(LineCollection(list(pieces[..., :2]), colors=colour, lw=width, alpha=alpha))


def _around(elevation: float) -> Tensor:
    return torch.stack([_on_sphere(azimuth, elevation) for azimuth in range(0, 361, 4)])


def _on_sphere(azimuth: float, elevation: float) -> Tensor:
    a, e = math.radians(azimuth), math.radians(elevation)
    return torch.tensor([-math.cos(e) * math.sin(a), math.sin(e), math.cos(e) * math.cos(a)], dtype=torch.float64)


def _projected(onlooker: Tensor, points: Tensor) -> Points:
    """Points (N, 3) in the object's axes as the onlooker sees them: right, up and towards them."""
    projected: Points = (points @ onlooker.mT).numpy()
    return projected
