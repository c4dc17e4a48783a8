"""Curves of average precision over thresholds, as NOCS and the paper draw them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from kfit.geometry import CATEGORIES
from kfit.metrics import NOCSScores

_COLORS = ("#4477aa", "#ee6677", "#228833", "#ccbb44", "#66ccee", "#aa3377")  # Paul Tol's bright scheme
_MEAN = "#222222"
_ROWS = (*CATEGORIES, "mean")


def curves_by_category(scores: Mapping[str, NOCSScores], shift_label: str = "translation error [cm]") -> Figure:
    """A row of plots a method: AP over 3D overlap, rotation and translation, a curve a category and one for the mean.

    Args:
        scores: by the method's name.
        shift_label: label of the translation thresholds.
    """
    figure = Figure(figsize=(10.5, 3.1 * len(scores) + 0.5), layout="constrained")
    axes = figure.subplots(len(scores), 3, squeeze=False)
    for row, (name, score) in zip(axes, scores.items(), strict=True):
        for plot, part in zip(row, _PARTS, strict=True):
            thresholds, precision = _curves(score, part)
            for category, values, color in zip(_ROWS, precision, (*_COLORS, _MEAN), strict=True):
                mean = category == "mean"
                plot.plot(
                    thresholds,
                    100 * values,
                    color=color,
                    label=category,
                    lw=2 if mean else 1.4,
                    ls="--" if mean else "-",
                )
            _dress(plot, shift_label if part == "translation" else _LABELS[part], thresholds)
        row[0].set_ylabel(f"{name}\naverage precision [%]" if len(scores) > 1 else "average precision [%]")
    handles, labels = axes[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(_ROWS), frameon=False)
    return figure


def curves_by_method(
    scores: Mapping[str, NOCSScores], part: str, shift_label: str = "translation error [cm]"
) -> Figure:
    """A plot a category and one for the mean: AP over the thresholds, a curve a method (the paper's comparisons).

    Args:
        scores: by the method's name.
        part: ``"iou"``, ``"rotation"`` or ``"translation"``.
        shift_label: label of the translation thresholds.

    Raises:
        ValueError: for a part of another name.
    """
    if part not in _PARTS:
        raise ValueError(f"part must be one of {', '.join(_PARTS)}, got {part!r}")
    figure = Figure(figsize=(12, 5.6), layout="constrained")
    axes = figure.subplots(2, 4)
    for index, (category, plot) in enumerate(zip(_ROWS, axes.flat, strict=False)):
        for method, (name, score) in enumerate(scores.items()):
            thresholds, precision = _curves(score, part)
            # Curves that coincide stay visible: later ones are drawn with gaps.
            style = "-" if method == 0 else (0, (5, 1 + method))
            plot.plot(thresholds, 100 * precision[index], color=_COLORS[method % 6], label=name, lw=1.6, ls=style)
        _dress(plot, shift_label if part == "translation" else _LABELS[part], thresholds)
        plot.set_title(category, fontsize=10)
    for plot in axes[:, 0]:
        plot.set_ylabel("average precision [%]")
    axes.flat[-1].axis("off")
    axes.flat[-1].legend(*axes.flat[0].get_legend_handles_labels(), loc="center", frameon=False)
    return figure


_LABELS = {"iou": "3D IoU [%]", "rotation": "rotation error [°]", "translation": ""}
_PARTS = tuple(_LABELS)


def _curves(scores: NOCSScores, part: str) -> tuple[np.ndarray, np.ndarray]:
    """Thresholds (K,) and AP (7, K); of rotation at any translation and the reverse."""
    if part == "iou":
        return 100 * np.array(scores.ious), scores.iou_ap
    if part == "rotation":
        return np.array(scores.degrees[:-1]), scores.pose_ap[:, :-1, -1]
    return np.array(scores.shifts[:-2]), scores.pose_ap[:, -1, :-2]


def _dress(plot: Axes, label: str, thresholds: np.ndarray) -> None:
    plot.set(xlabel=label, xlim=(thresholds[0], thresholds[-1]), ylim=(-2, 102))
    plot.grid(alpha=0.3)
    plot.spines[["top", "right"]].set_visible(False)
