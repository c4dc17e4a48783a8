"""The paper's figures, drawn of what `kfit.bench.paper.units` measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from kfit.bench.paper.intervals import mean_of, share_below
from kfit.geometry import EDGES, box_corners, project

Arrays = Mapping[str, NDArray[Any]]
COLORS = ("#4477aa", "#ee6677", "#228833", "#ccbb44", "#66ccee", "#aa3377")  # Paul Tol's bright scheme


def curves(found: Mapping[str, Mapping[str, Arrays]], what: str, label: str, limit: float) -> Figure:
    """Average precision over thresholds: a plot a category, a curve a method.

    With one view of one object a picture and no detector, AP at a threshold is the share of views below it. Bands are
    Wilson's 95 % intervals.

    Args:
        found: by category and the method's title.
        what: the errors' name; methods without them are left out.
        label: label of the thresholds.
        limit: largest threshold.
    """
    figure = Figure(figsize=(max(5.2, 4.2 * len(found) + 0.4), 4.2), layout="constrained")
    thresholds = np.linspace(0, limit, 121)
    for plot, (category, methods) in zip(figure.subplots(1, len(found), squeeze=False)[0], found.items(), strict=True):
        for index, (title, arrays) in enumerate(methods.items()):
            if what in arrays:
                shares = np.array([share_below(arrays[what], threshold) for threshold in thresholds]).T
                plot.plot(thresholds, shares[0], color=COLORS[index % 6], label=title, lw=1.6)
                plot.fill_between(thresholds, *shares[1:], color=COLORS[index % 6], alpha=0.12, lw=0)
        plot.set(xlabel=label, ylabel="average precision [%]", xlim=(0, limit), ylim=(-2, 102), title=category)
        _dress(plot)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    # A column is some two inches wide.
    columns = min(len(labels), int(figure.get_figwidth() / 2.2))
    figure.legend(handles, labels, loc="outside lower center", ncols=columns, frameon=False)
    return figure


def iterations(found: Mapping[str, Arrays]) -> Figure:
    """Median energy and rotation error of the starts that won, over the steps, with the middle half of the views."""
    figure = Figure(figsize=(4.4 * len(found), 3.2), layout="constrained")
    for plot, (category, arrays) in zip(figure.subplots(1, len(found), squeeze=False)[0], found.items(), strict=True):
        right = plot.twinx()
        for axes, name, label, color in (
            (plot, "path_energy", "energy", COLORS[0]),
            (right, "path_rotation", "rotation error [°]", COLORS[1]),
        ):
            low, median, high = np.nanquantile(arrays[name], (0.25, 0.5, 0.75), axis=0)
            axes.plot(median, color=color, lw=1.6)
            axes.fill_between(np.arange(len(median)), low, high, color=color, alpha=0.15, lw=0)
            axes.set_ylabel(label, color=color)
            axes.set_ylim(bottom=0)
        plot.set(xlabel="step", title=category, xlim=(0, arrays["path_energy"].shape[1] - 1))
        _dress(plot)
    return figure


def robustness(found: Mapping[str, Mapping[str, tuple[Sequence[float], NDArray[Any]]]], limits: Arrays) -> Figure:
    """Mean rotation error over how far pictures are changed, a plot a change.

    Bands are a bootstrap's 95 % intervals; shaded grey is what the regressor was trained on.

    Args:
        found: by change and the method's title: strengths, and errors (L, N) at each.
        limits: by change, (low, high) of the regressor's training.
    """
    figure = Figure(figsize=(3.6 * len(found), 3.3), layout="constrained")
    for plot, (change, methods) in zip(figure.subplots(1, len(found), squeeze=False)[0], found.items(), strict=True):
        plot.axvspan(*(100 * limits[change]), color="0.92", lw=0)
        for index, (title, (strengths, errors)) in enumerate(methods.items()):
            order = np.argsort(strengths)
            percent, wrong = 100 * np.array(strengths)[order], np.nan_to_num(errors, nan=180.0)[order]
            mean, low, high = np.array([mean_of(one) for one in wrong]).T
            plot.plot(percent, mean, "o-", color=COLORS[index], label=title, lw=1.6, ms=4)
            plot.fill_between(percent, low, high, color=COLORS[index], alpha=0.15, lw=0)
        plot.set(xlabel=f"{change} [%]", ylabel="mean rotation error [°]")
        plot.set_ylim(bottom=0)
        _dress(plot)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False)
    return figure


def samples(found: Mapping[str, NDArray[Any]]) -> Figure:
    """Objects drawn from the prior: a row a network."""
    count = max(len(pictures) for pictures in found.values())
    figure = Figure(figsize=(1.1 * count + 1.6, 1.15 * len(found)), layout="constrained")
    plots = figure.subplots(len(found), count, squeeze=False)
    for row, (title, pictures) in zip(plots, found.items(), strict=True):
        for plot, picture in zip(row, pictures, strict=False):
            plot.imshow(picture.transpose(1, 2, 0))
        for plot in row:
            _bare(plot)
        row[0].set_ylabel(title, rotation=0, ha="right", va="center")
    return figure


def side_by_side(photos: NDArray[Any], camera: NDArray[Any], found: Mapping[str, Arrays]) -> Figure:
    """What methods answered, a column a view: the fitted drawings, and boxes and axes on the crops.

    Args:
        photos: (V, H, W, 3) bytes.
        camera: (V, 3, 3) of them.
        found: by the method's title; each with ``box_…``, and where it draws ``drawing``.
    """
    rows: list[tuple[str, Arrays | None, str]] = [("seen", None, "photo")]
    for title in found:
        if "drawing" in found[title]:
            rows.append((f"{title},\ndrawing", found[title], "drawing"))
        rows.append((f"{title},\npose", found[title], "box"))
    figure = Figure(figsize=(1.5 * len(photos) + 1.6, 1.55 * len(rows)), layout="constrained")
    plots = figure.subplots(len(rows), len(photos), squeeze=False)
    for row, (title, arrays, kind) in zip(plots, rows, strict=True):
        for view, plot in enumerate(row):
            if kind == "drawing" and arrays is not None:
                plot.imshow(arrays["drawing"][view].transpose(1, 2, 0))
            else:
                plot.imshow(photos[view])
            if kind == "box" and arrays is not None:
                pose = [arrays[f"box_{name}"][view] for name in ("rotation", "translation", "size")]
                _box(plot, pose, camera[view])
                plot.set_xlabel(f"{arrays['rotation_deg'][view]:.0f}°")
            plot.set(xlim=(-0.5, photos.shape[2] - 0.5), ylim=(photos.shape[1] - 0.5, -0.5))
            _bare(plot)
        row[0].set_ylabel(title, rotation=0, ha="right", va="center")
    return figure


def _box(plot: Axes, pose: Sequence[Any], camera: Any) -> None:
    """The box, and axes x red, y green, z blue."""
    turn, place, sides, lens = (torch.as_tensor(part).double() for part in (*pose, camera))
    if not bool(torch.isfinite(place).all()):
        plot.text(0.5, 0.5, "failed", ha="center", va="center", transform=plot.transAxes)
        return
    corners = project(box_corners(turn, place, sides), lens).numpy()
    for i, j in EDGES:
        plot.plot(*corners[[i, j]].T, color="#ffb000", lw=0.9)
    tips = project(torch.cat((place[None], place + 0.35 * sides.norm() * turn.mT)), lens).numpy()
    for tip, color in zip(tips[1:], ("#e62828", "#1eaa3c", "#285af0"), strict=True):
        plot.plot(*np.stack((tips[0], tip)).T, color=color, lw=1.6)


def _bare(plot: Axes) -> None:
    plot.set(xticks=[], yticks=[])
    plot.spines[:].set_visible(False)


def _dress(plot: Axes) -> None:
    plot.grid(alpha=0.3)
    plot.spines[["top"]].set_visible(False)
