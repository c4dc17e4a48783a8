"""The energy of every start over the steps of a fit."""

from __future__ import annotations

from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from kfit.core import FitResult
from kfit.reports.inline_svg import ACCENT, INK, MUTED, PAPER, inline_svg, styled


def energy_curves(fit: FitResult, answer: int) -> tuple[Markup, float]:
    """Draw a line a start, which ends where the start left the fit.

    The winner's is strong, other survivors' are thin, those of pruned and dropped starts fade and end in a cross.
    Each is a group named ``start-N``; a line named ``now`` stands at the first step, to be moved.

    Args:
        fit: fit of one problem.
        answer: the step at which the winner was best.

    Returns:
        An ``<svg>`` element, and the width of a step in its units.
    """
    energy, won = fit.history.energy[:, 0].double().numpy(), int(fit.start[0])
    left = set(range(energy.shape[1])) - set(fit.all_start.tolist())
    with styled():
        figure = Figure(figsize=(5.2, 3.4), layout="constrained")
        plot = figure.subplots()
        for start, path in enumerate(energy.T):
            steps = np.flatnonzero(np.isfinite(path))
            points = np.stack([steps, path[steps]], 1)
            if start in left:
                pieces = np.stack([points[:-1], points[1:]], 1) if len(points) > 1 else points[None]
                fading = np.linspace(0.9, 0.35, len(pieces))
                plot.add_collection(
                    LineCollection(list(pieces), colors=MUTED, alpha=fading, lw=1.2, gid=f"start-{start}")
                )
                plot.plot(*points[-1:].T, "x", color=MUTED, ms=5)
            else:
                strong: dict[str, Any] = (
                    {"color": ACCENT, "lw": 2.4, "zorder": 3} if start == won else {"color": INK, "lw": 1.1}
                )
                plot.plot(*points.T, gid=f"start-{start}", **strong)
        plot.plot(answer, energy[answer, won], "o", color=ACCENT, mec=PAPER, mew=1.5, ms=9, zorder=4)
        plot.axvline(0, color=MUTED, lw=1, ls=(0, (2, 2)), gid="now")
        last = max(1, len(energy) - 1)
        plot.set(xlabel="step", ylabel="energy (lower is better)", xlim=(-0.02 * last, 1.03 * last))
        plot.xaxis.set_major_locator(MaxNLocator(integer=True))
        plot.margins(y=0.08)
        plot.spines[["top", "right"]].set_visible(False)
        plot.grid(axis="y", color=MUTED, alpha=0.25, lw=0.8)
        shown = {"the answer": Line2D([], [], color=ACCENT, lw=2.4, marker="o", mec=PAPER, ms=8)}
        if len(fit.all_start) > 1:
            shown["other starts"] = Line2D([], [], color=INK, lw=1.1)
        if left:
            shown["given up"] = Line2D([], [], color=MUTED, lw=1.2, marker="x", ms=5)
        plot.legend(list(shown.values()), list(shown), frameon=False, loc="upper right", bbox_to_anchor=(0.95, 1.0))
        alt = (
            f"Energy over {len(energy) - 1} steps of {energy.shape[1]} starts, of which {len(left)} were given up on "
            f"the way; the answer falls from {energy[0, won]:.2f} to {energy[answer, won]:.2f}"
        )
        svg = inline_svg(figure, alt)
    low, high = plot.get_xlim()
    return svg, float(72 * figure.get_figwidth() * plot.get_position().width / (high - low))
