"""A fit on one page that needs nothing but a browser: the photo, the fit's way, its confidence, and the numbers."""

from __future__ import annotations

import base64
import io
import json
import math
import platform
from pathlib import Path

import torch
from markupsafe import Markup
from PIL import Image

from kfit import __version__
from kfit.pose import PoseResult
from kfit.reports.energy_curves import energy_curves
from kfit.reports.fit_frames import Picture, fit_frames
from kfit.reports.fitted_photo import fitted_photo
from kfit.reports.scene import VIEWER, scene, scene_html, templates
from kfit.reports.view_sphere import view_sphere
from kfit.reports.words import camera_angles, words_of
from kfit.runtime.atomic_write import atomic_write

# What the terms of kfit's own fits compare.
TERMS = {
    "perceptual": "a network's features of drawing and photo differ",
    "ssim": "local structure of drawing and photo differs (1 − SSIM)",
    "silhouette": "the drawing's silhouette misses the mask",
    "depth": "the drawing's depth misses the measured depth",
    "prior": "the code lies off those of training",
    "pose": "the pose is improbable by the pose head",
    "lens": "the focal length is unlike those of lenses",
}
CAMERA = {"fx": (0, 0), "fy": (1, 1), "cx": (0, 2), "cy": (1, 2)}


def report(result: PoseResult, path: str | Path = "report.html", command: str | None = None) -> Path:
    """Write a page about a fit: one HTML file that loads nothing from elsewhere.

    It shows the photo with the box, the axes and the drawing's contour; the drawing at each step with the observation;
    the energies of all starts; the camera of the answer and of its alternatives; and the numbers.

    Args:
        result: result of `kfit.pose.CategoryModel.pose`.
        path: path of the file.
        command: command that created it, which the page names.

    Example:
        >>> import numpy as np, kfit
        >>> image, mask = np.ones((96, 96, 3)), np.zeros((96, 96))
        >>> image[20:80, 30:70], mask[20:80, 30:70] = (0.7, 0.2, 0.1), 1
        >>> model = kfit.load("mug")
        >>> short = model.pipeline(num_starts=1, num_steps=1)  # for this example
        >>> kfit.report(model.pose(image, mask=mask, pipeline=short), "page.html").name
        'page.html'
    """
    place = Path(path)
    text = page(result, command)
    return atomic_write(place.parent, {place.name: lambda aside: aside.write_text(text, encoding="utf-8")})[0]


def page(result: PoseResult, command: str | None = None) -> str:
    """The page that `report` writes."""
    frames = fit_frames(result)
    words = words_of(result)
    curves, step_width = energy_curves(result.fit, frames.answer)
    rooms, space = templates(), scene(result)
    rooms.filters["to"] = number
    return rooms.get_template("page.html").render(
        result=result,
        words=words,
        scene=space,
        space=scene_html(result, space),
        viewer=Markup(VIEWER.read_text(encoding="utf-8")),
        terms=TERMS,
        size_from=_size_from(result),
        distance_from={"given": "by the given camera", "EXIF": "by the EXIF tags' lens"}.get(
            result.intrinsics_from, "by an estimated lens"
        ),
        numbers_json=Markup(json.dumps(result.to_dict()).replace("<", "\\u003c")),
        title=f"{result.category}, {words.distance}",
        photo=_address(fitted_photo(result), "JPEG"),
        observed=_address(frames.observed, "PNG"),
        drawings=[_address(drawing, "PNG") for drawing in frames.drawings],
        frames=frames,
        curves=curves,
        step_width=step_width,
        sphere=view_sphere(result),
        symmetric=result.symmetry == "y",
        cameras=[camera_angles(found.rotation, result.translation) for found in result.alternatives],
        numbers=_numbers(result),
        command=command,
        versions={"kfit": __version__, "torch": torch.__version__, "Python": platform.python_version()},
    )


def number(value: float, digits: int) -> str:
    """Format a number with a typographic minus sign; a dash if it is undefined."""
    return "–" if math.isnan(value) else f"{round(value, digits) + 0.0:.{digits}f}".replace("-", "−")


def _numbers(result: PoseResult) -> list[tuple[str, list[tuple[str, str]], str]]:
    """Return rows of the table: name, named parts with units, and meaning."""
    view = zip(("azimuth", "elevation", "roll"), camera_angles(result.rotation, result.translation), strict=True)
    axes = ("x", "y", "z")
    cm = [[f"{number(100 * part, 1)} cm" for part in parts] for parts in (result.translation, result.size)]
    quaternion = [number(part, 4) for part in result.quaternion_wxyz]
    return [
        (
            "View",
            [(name, f"{number(angle, 1)}°") for name, angle in view],
            "where the camera is about the object, along the ray to it",
        ),
        ("Rotation", list(zip(("w", *axes), quaternion, strict=True)), "unit quaternion, object to camera"),
        (
            "Translation",
            list(zip(axes, cm[0], strict=True)),
            "the object's centre from the camera: right, down, forward",
        ),
        ("Size", list(zip(axes, cm[1], strict=True)), f"the box along the object's axes, {_size_from(result)}"),
        (
            "Camera",
            [(name, f"{number(result.intrinsics[place], 1)} px") for name, place in CAMERA.items()],
            f"intrinsics, {'by EXIF tags' if result.intrinsics_from == 'EXIF' else result.intrinsics_from}",
        ),
    ]


def _size_from(result: PoseResult) -> str:
    return {"depth": "by depth", "views": "by several views"}.get(result.size_from, "by the category's mean size")


def _address(picture: Picture, kind: str) -> str:
    """A picture as an address that holds it."""
    held = io.BytesIO()
    Image.fromarray(picture).save(held, kind, **({"quality": 88} if kind == "JPEG" else {"optimize": True}))
    return f"data:image/{kind.lower()};base64,{base64.b64encode(held.getvalue()).decode()}"
