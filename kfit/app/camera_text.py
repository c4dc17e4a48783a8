"""Intrinsics as people type them."""

from __future__ import annotations

import math

from kfit.app.session import Camera


def camera_of(text: str | None) -> Camera | None:
    """Read fx, fy, cx and cy in pixels, with spaces or commas between them; None where nothing was typed.

    Raises:
        ValueError: if it is not four numbers.

    >>> camera_of("591, 590, 322.5, 244")
    (591.0, 590.0, 322.5, 244.0)
    """
    words = (text or "").replace(",", " ").split()
    if not words:
        return None
    try:
        fx, fy, cx, cy = map(float, words)
    except ValueError:
        raise ValueError(f"The camera must be four numbers, fx fy cx cy in pixels, got {text!r}.") from None
    if not all(map(math.isfinite, (fx, fy, cx, cy))):
        raise ValueError(f"The camera must be four finite numbers, got {text!r}.")
    return fx, fy, cx, cy
