"""A fit on one page that needs nothing but a browser: the photo, the fit's way, how sure it is, and the numbers."""

from __future__ import annotations

import base64
import io
import math
import platform
from pathlib import Path

import cv2
import numpy as np
import torch
from jinja2 import Environment, PackageLoader, StrictUndefined
from numpy.typing import NDArray
from PIL import Image

from kfit import __version__
from kfit.geometry import CATEGORIES
from kfit.pose import PoseResult
from kfit.reports.energy_curves import energy_curves
from kfit.reports.fit_frames import Picture, fit_frames
from kfit.reports.overlay import draw_overlay
from kfit.reports.view_sphere import camera_angles, view_sphere
from kfit.runtime.atomic_write import atomic_write

CAMERA = {"fx": (0, 0), "fy": (1, 1), "cx": (0, 2), "cy": (1, 2)}


def report(result: PoseResult, path: str | Path = "report.html", command: str | None = None) -> Path:
    """Write a page about a fit: one HTML file that asks for nothing from elsewhere.

    It shows the photo with the box, the axes and the drawing's contour; the drawing at each step beside what was seen;
    the energies of all starts; where the camera is, by the answer and by its alternatives; and the numbers.

    Args:
        result: of `kfit.pose.CategoryModel.pose`.
        path: of the file.
        command: that made it, to be named.
    """
    place = Path(path)
    text = page(result, command)
    return atomic_write(place.parent, {place.name: lambda aside: aside.write_text(text, encoding="utf-8")})[0]


def page(result: PoseResult, command: str | None = None) -> str:
    """The page that `report` writes."""
    frames = fit_frames(result)
    curves, step_width = energy_curves(result.fit, frames.answer)
    # Strict, so that a misspelt name is no empty place; and what goes in is escaped but for the plots.
    rooms = Environment(
        loader=PackageLoader("kfit", "reports"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    rooms.filters["to"] = number
    return rooms.get_template("page.html").render(
        result=result,
        title=f"{result.category}, {100 * result.translation[2]:.0f} cm away",
        photo=_address(_photo(result), "JPEG"),
        observed=_address(frames.observed, "PNG"),
        drawings=[_address(drawing, "PNG") for drawing in frames.drawings],
        frames=frames,
        curves=curves,
        step_width=step_width,
        sphere=view_sphere(result),
        symmetric=CATEGORIES[result.category].symmetry == "y",
        cameras=[camera_angles(found.rotation, result.translation) for found in result.alternatives],
        numbers=_numbers(result),
        command=command,
        versions={"kfit": __version__, "torch": torch.__version__, "Python": platform.python_version()},
    )


def number(value: float, digits: int) -> str:
    """A number as people read it, with a minus sign that is no hyphen; a dash for what is not defined."""
    return "–" if math.isnan(value) else f"{round(value, digits) + 0.0:.{digits}f}".replace("-", "−")


def _photo(result: PoseResult) -> Picture:
    """The photo with box, axes and the outline of the drawing's silhouette."""
    rotation, translation, size, camera = (
        torch.from_numpy(part) for part in (result.rotation, result.translation, result.size, result.intrinsics)
    )
    silhouette = result.draw(result.fit.values).mask
    outlined = None if silhouette is None else _in_photo(silhouette[0, 0].numpy(), result)
    return draw_overlay(result.image, rotation, translation, size, camera, mask=outlined)


def _in_photo(silhouette: NDArray[np.float32], result: PoseResult) -> NDArray[np.float32]:
    height, width = result.image.shape[:2]
    placed: NDArray[np.float32] = cv2.warpAffine(
        silhouette, result.crop.crop_to_image[:2].numpy(), (width, height), flags=cv2.INTER_LINEAR
    )
    return placed


def _numbers(result: PoseResult) -> list[tuple[str, list[tuple[str, str]], str]]:
    """Rows of the table: what, its named parts with units, and what it means."""
    azimuth, elevation = camera_angles(result.rotation, result.translation)
    roll = (math.degrees(float(result.fit.values["roll"][0])) + 180) % 360 - 180
    view = {"azimuth": azimuth, "elevation": elevation, "roll": roll}
    axes = ("x", "y", "z")
    cm = [[f"{number(100 * part, 1)} cm" for part in parts] for parts in (result.translation, result.size)]
    quaternion = [number(part, 4) for part in result.quaternion_wxyz]
    size_from = "by depth" if result.size_from == "depth" else "by the category's mean size"
    return [
        (
            "View",
            [(name, f"{number(angle, 1)}°") for name, angle in view.items()],
            "where the camera is about the object, along the ray to it",
        ),
        ("Rotation", list(zip(("w", *axes), quaternion, strict=True)), "unit quaternion, object to camera"),
        (
            "Translation",
            list(zip(axes, cm[0], strict=True)),
            "the object's centre from the camera: right, down, forward",
        ),
        ("Size", list(zip(axes, cm[1], strict=True)), f"the box along the object's axes, {size_from}"),
        (
            "Camera",
            [(name, f"{number(result.intrinsics[place], 1)} px") for name, place in CAMERA.items()],
            f"intrinsics, {'by EXIF tags' if result.intrinsics_from == 'EXIF' else result.intrinsics_from}",
        ),
    ]


def _address(picture: Picture, kind: str) -> str:
    """A picture as an address that holds it."""
    held = io.BytesIO()
    Image.fromarray(picture).save(held, kind, **({"quality": 88} if kind == "JPEG" else {"optimize": True}))
    return f"data:image/{kind.lower()};base64,{base64.b64encode(held.getvalue()).decode()}"
