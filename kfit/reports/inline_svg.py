"""A plot as a part of a page: an SVG element in the page's own letters and colours, light or dark."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from threading import RLock
from typing import Any

import matplotlib
from markupsafe import Markup
from matplotlib.figure import Figure

# Colours that a plot uses, and variables of the page's style sheet that stand for them.
INK, MUTED, ACCENT, PAPER = "#010203", "#040506", "#070809", "#0a0b0c"
VARIABLES = {INK: "--ink", MUTED: "--muted", ACCENT: "--accent", PAPER: "--paper"}
STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "font.size": 11.0,
    "text.color": INK,
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
}

_ALONE = RLock()


@contextmanager
def styled(**settings: Any) -> Iterator[None]:
    """Matplotlib's settings for a plot; they are the process's, so threads make their plots one after another."""
    with _ALONE, matplotlib.rc_context(STYLE | settings):
        yield


def inline_svg(figure: Figure, alt: str) -> Markup:
    """The figure as an ``<svg>`` element that scales with its surroundings.

    Args:
        figure: made within `styled`, in the colours above.
        alt: alternative text.
    """
    text = io.StringIO()
    nothing = dict.fromkeys(("Creator", "Date", "Format", "Type"))
    with styled(**{"svg.hashsalt": alt}):
        figure.savefig(text, format="svg", transparent=True, metadata=nothing)
    _, _, drawn = text.getvalue().partition("<svg ")
    # The names that Matplotlib gives to groups would be there twice on a page of two plots.
    inside = re.sub(r' id="[A-Za-z0-9.]+_\d+"', "", drawn.partition(">")[2])
    for colour, variable in VARIABLES.items():
        inside = inside.replace(colour, f"var({variable})")
    width, height = (72 * side for side in figure.get_size_inches())
    head = Markup('<svg role="img" aria-label="{}" viewBox="0 0 {:g} {:g}">').format(alt, width, height)
    return head + Markup(inside)
