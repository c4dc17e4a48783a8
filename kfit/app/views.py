"""What the page shows, as HTML and pictures inside it: nothing is asked of the net, and nothing is left on the disk."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Sequence
from html import escape
from io import BytesIO
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image

from kfit.app.watched import Drawn
from kfit.pose import PoseResult
from kfit.reports import describe, draw_overlay

# Of the longer side, in pixels.
SHOWN = 1280
# What is not object is shown through a veil of this much black.
VEIL = 0.6


def photo_shown(image: NDArray[np.float32]) -> str:
    """A photo (H, W, 3) in [0, 1] as the address of an image."""
    return _address(np.round(_small(image) * 255).astype(np.uint8), "JPEG")


def mask_shown(mask: NDArray[np.float32]) -> str:
    """A picture to lay over the photo: a veil over all but the object of the mask (H, W), and its outline in white."""
    there = (_small(mask) > 0.5).astype(np.uint8)
    layer = np.zeros((*there.shape, 4), np.uint8)
    layer[there == 0, 3] = round(255 * VEIL)
    outlines, _ = cv2.findContours(there, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    cv2.polylines(layer, outlines, True, (255, 255, 255, 255), max(1, round(max(there.shape) / 300)), cv2.LINE_AA)
    return _address(layer, "PNG")


def waiting(before: int) -> str:
    """What a visitor sees before whom others' fits are still to run."""
    others = "1 other fit is" if before == 1 else f"{before} other fits are"
    return f'<p class="kfit-busy" role="status">{others} before yours; it begins by itself …</p>'


def converging(steps: Sequence[Drawn]) -> str:
    """What is seen and what is drawn, side by side, while a fit runs that has told so much."""
    if not steps:
        return '<p class="kfit-busy" role="status">Loading the model …</p>'
    now = steps[-1]
    share = now.step / max(1, now.num_steps)
    return (
        f'<p class="kfit-busy" role="status">Step {now.step} of {now.num_steps}: {now.num_starts} starts on their way, '
        f"the best at energy {now.energy:.3f}</p>"
        f'<div class="kfit-bar"><div style="width: {100 * share:.0f}%"></div></div>'
        f"{_pair(now.observed, now.drawing)}{_curve(steps)}"
    )


def answered(result: PoseResult, steps: Sequence[Drawn]) -> str:
    """The answer: the photo with box and axes, one line, notes, and how the fit went."""
    rotation, translation, size, camera = (
        torch.from_numpy(part) for part in (result.rotation, result.translation, result.size, result.intrinsics)
    )
    overlay = _address(draw_overlay(result.image, rotation, translation, size, camera, mask=result.mask), "JPEG")
    line = describe(result)
    notes = "".join(f"<li>{escape(note[:1].upper() + note[1:])}.</li>" for note in result.notes)
    return (
        f'<img class="kfit-overlay" src="{overlay}" alt="The photo with the fitted box and axes">'
        f'<p class="kfit-answer">{escape(line[:1].upper() + line[1:])}.</p>'
        + (f'<ul class="kfit-notes">{notes}</ul>' if notes else "")
        + _pair(steps[-1].observed, result.drawing)
        + _curve(steps)
    )


def _pair(observed: NDArray[np.float32], drawn: NDArray[np.float32]) -> str:
    """Two small pictures (S, S, 3) in [0, 1]."""
    both = (("seen", observed, "What is seen of the object"), ("drawn", drawn, "The drawing that is fitted to it"))
    figures = "".join(
        f'<figure><img src="{_address(np.round(picture.clip(0, 1) * 255).astype(np.uint8), "PNG")}" alt="{caption}">'
        f"<figcaption>{name}</figcaption></figure>"
        for name, picture, caption in both
    )
    return f'<div class="kfit-pair">{figures}</div>'


def _curve(steps: Sequence[Drawn]) -> str:
    """How the least energy fell."""
    if len(steps) < 2:
        return ""
    energies = [drawn.energy for drawn in steps]
    low, span = min(energies), max(max(energies) - min(energies), 1e-9)
    points = " ".join(
        f"{300 * drawn.step / steps[-1].num_steps:.1f},{44 - 40 * (drawn.energy - low) / span:.1f}" for drawn in steps
    )
    return (
        '<figure class="kfit-curve"><svg viewBox="0 0 300 48" preserveAspectRatio="none" role="img" '
        f'aria-label="Energy from {energies[0]:.3f} to {low:.3f}"><polyline points="{points}"/></svg>'
        f"<figcaption>energy, from {energies[0]:.3f} to {low:.3f}: how badly the drawing explains the photo"
        "</figcaption></figure>"
    )


def _small(picture: NDArray[np.float32]) -> NDArray[np.float32]:
    factor = min(1.0, SHOWN / max(picture.shape[:2]))
    size = (max(1, round(picture.shape[1] * factor)), max(1, round(picture.shape[0] * factor)))
    small: Any = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    return small  # type: ignore[no-any-return]


def _address(pixels: NDArray[np.uint8], kind: str) -> str:
    file = BytesIO()
    Image.fromarray(pixels).save(file, kind, **({"quality": 88} if kind == "JPEG" else {}))
    return f"data:image/{kind.lower()};base64,{b64encode(file.getvalue()).decode()}"
