"""What the page shows, as HTML and pictures inside it: nothing is asked of the net, and nothing is left on the disk."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Sequence
from functools import cache
from html import escape
from io import BytesIO
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from kfit.app.examples import EXAMPLES
from kfit.app.watched import Drawn
from kfit.pose import PoseResult
from kfit.pose.object_finder import FoundObject
from kfit.reports.fitted_photo import fitted_photo
from kfit.reports.words import words_of

# Of the longer side, in pixels: of photos, of photos while a fit runs, and of the examples' thumbnails.
SHOWN, MOVING, THUMBNAIL = 1280, 720, 360
# What is not object is shown through a veil of this much black.
VEIL = 0.6
STEPS = ("Photo", "Object", "Answer")


def steps(now: int) -> str:
    """Where a visitor is, ``now`` counted from 0."""
    items = "".join(
        f"<li{' aria-current=step' if number == now else ''}{' class=kfit-done' if number < now else ''}>"
        f"<b>{number + 1}</b> {name}</li>"
        for number, name in enumerate(STEPS)
    )
    return f'<ol class="kfit-steps">{items}</ol>'


def problem(sentence: str) -> str:
    """A message where the problem is."""
    return f'<p class="kfit-problem" role="alert">{escape(sentence)}</p>' if sentence else ""


@cache
def cards() -> str:
    """The examples, each a button with a thumbnail."""
    buttons = "".join(
        f'<button type="button" class="kfit-card" data-example="{example.name}">'
        f'<img src="{_address(_small(example.image(), THUMBNAIL), "JPEG")}" alt="">'
        f"<span>{example.title}</span></button>"
        for example in EXAMPLES
    )
    return f'<p class="kfit-or">Or press an example, and watch:</p><div class="kfit-cards">{buttons}</div>'


def photo_shown(image: NDArray[np.float32]) -> str:
    """A photo (H, W, 3) in [0, 1] as the address of an image."""
    return _address(_bytes(_small(image, SHOWN)), "JPEG")


def mask_shown(mask: NDArray[np.float32]) -> str:
    """A picture to lay over the photo: a veil over all but the object of the mask (H, W), and its outline in white."""
    there = (_small(mask, SHOWN) > 0.5).astype(np.uint8)
    layer = np.zeros((*there.shape, 4), np.uint8)
    layer[there == 0, 3] = round(255 * VEIL)
    outlines, _ = cv2.findContours(there, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    cv2.polylines(layer, outlines, True, (255, 255, 255, 255), max(1, round(max(there.shape) / 300)), cv2.LINE_AA)
    return _address(layer, "PNG")


def found_shown(targets: Sequence[FoundObject], shape: tuple[int, int]) -> str:
    """Outlines of what was found in a photo of that height and width, where there is a choice."""
    height, width = shape
    shown = []
    for number, target in enumerate(targets if len(targets) > 1 else ()):
        left, top, across, down = (
            part / whole for part, whole in zip(target.box, (width, height, width, height), strict=True)
        )
        place = f"left:{100 * left:.2f}%;top:{100 * top:.2f}%;width:{100 * across:.2f}%;height:{100 * down:.2f}%"
        box = f"{left:.4f} {top:.4f} {across:.4f} {down:.4f}"
        shown.append(
            f'<div class="kfit-found" data-number="{number}" data-box="{box}" style="{place}">'
            f"<span>{escape(target.category)}</span></div>"
        )
    return "".join(shown)


def waiting(before: int) -> str:
    """What a visitor sees before whom others' fits are still to run."""
    others = "1 other fit is" if before == 1 else f"{before} other fits are"
    return f'<p class="kfit-busy" role="status">{others} before yours; it starts automatically …</p>'


def converging(steps: Sequence[Drawn], image: NDArray[np.float32]) -> str:
    """The drawing in the photo while a fit runs, after these steps."""
    if not steps:
        return '<p class="kfit-busy" role="status">Loading the model …</p>'
    now = steps[-1]
    share = now.step / max(1, now.num_steps)
    return (
        f'<p class="kfit-busy" role="status">Step {now.step} of {now.num_steps}: {now.num_starts} starts on their way, '
        f"the best at energy {now.energy:.3f}</p>"
        f'<div class="kfit-bar"><div style="width: {100 * share:.0f}%"></div></div>'
        f'<img class="kfit-overlay kfit-live" src="{_address(drawn_in(image, now), "JPEG")}" '
        f'alt="The drawing of this step in the photo">{_curve(steps)}'
    )


def answered(result: PoseResult, steps: Sequence[Drawn]) -> str:
    """The answer: the photo with outline, box and axes, words, notes, and how the fit went."""
    words = words_of(result)
    notes = "".join(f"<li>{escape(note[:1].upper() + note[1:])}.</li>" for note in result.notes)
    return (
        f'<img class="kfit-overlay" src="{_address(fitted_photo(result), "JPEG")}" '
        f'alt="The photo with the outline of the drawing, the fitted box and its axes">'
        f'<p class="kfit-answer">{escape(words.name.capitalize())} {escape(words.view)}; '
        f"{escape(words.size)}, {escape(words.distance)}.</p>"
        f'<div class="kfit-sure kfit-{words.level}"><p><b>{escape(words.confidence.capitalize())}.</b> '
        f"{escape(words.meaning)}</p>"
        f'<div class="kfit-bar"><div style="width: {100 * result.confidence:.0f}%"></div></div></div>'
        + (f'<ul class="kfit-notes">{notes}</ul>' if notes else "")
        + _pair(result.observation.field("image")[0].movedim(0, -1).numpy(), result.drawing)
        + _curve(steps)
    )


def drawn_in(image: NDArray[np.float32], now: Drawn) -> NDArray[np.uint8]:
    """A photo (H, W, 3), dimmed, with the drawing where the crop was taken."""
    small = _small(image, MOVING)
    height, width = small.shape[:2]
    scale = np.diag([width / image.shape[1], height / image.shape[0], 1.0])
    move = (scale @ now.crop.crop_to_image.numpy())[:2]
    drawing = cv2.warpAffine(np.ascontiguousarray(now.drawing), move, (width, height))
    # Drawings are on white.
    there = (now.drawing.min(-1) < 0.97).astype(np.float32) if now.silhouette is None else now.silhouette
    opaque = cv2.warpAffine(np.ascontiguousarray(there), move, (width, height))[..., None].clip(0, 1)
    return _bytes(opaque * drawing + (1 - opaque) * 0.6 * small)


def _pair(observed: NDArray[np.float32], drawn: NDArray[np.float32]) -> str:
    """Two small pictures (S, S, 3) in [0, 1]."""
    both = (("seen", observed, "What is seen of the object"), ("drawn", drawn, "The drawing that is fitted to it"))
    figures = "".join(
        f'<figure><img src="{_address(_bytes(picture), "PNG")}" alt="{caption}">'
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


def _small(picture: NDArray[Any], longest: int) -> Any:
    factor = min(1.0, longest / max(picture.shape[:2]))
    size = (max(1, round(picture.shape[1] * factor)), max(1, round(picture.shape[0] * factor)))
    return cv2.resize(picture, size, interpolation=cv2.INTER_AREA)


def _bytes(picture: NDArray[np.float32]) -> NDArray[np.uint8]:
    return np.round(picture.clip(0, 1) * 255).astype(np.uint8)


def _address(pixels: NDArray[np.uint8], kind: str) -> str:
    file = BytesIO()
    Image.fromarray(pixels).save(file, kind, **({"quality": 88} if kind == "JPEG" else {}))
    return f"data:image/{kind.lower()};base64,{b64encode(file.getvalue()).decode()}"
