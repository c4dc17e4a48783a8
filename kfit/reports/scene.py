"""What the 3D view of a report or of the app shows: mesh, box and cameras of an answer, as numbers for `viewer.js`."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from numpy.typing import NDArray

from kfit.pose import PoseResult
from kfit.reports.words import camera_angles, view_words

VIEWER = Path(__file__).with_name("viewer.js")
# In box diagonals: how far away a camera is drawn at most, as it would be out of the picture, and how large.
FARTHEST, PYRAMID = 1.15, 0.25
SHORT = 32767


def scene(result: PoseResult) -> dict[str, Any]:
    """Describe an answer for `viewer.js`, in the object's axes and in diagonals of its box.

    ``size`` (3,); ``mesh`` with 16-bit ``vertices``, 8-bit ``colors`` and 32-bit ``faces`` in base64, or None;
    ``views``: of each alternative the camera's angles in degrees, its place and the corners of its picture's pyramid.
    """
    diagonal = float(np.linalg.norm(result.size))
    return {
        "size": (result.size / diagonal).round(4).tolist(),
        "mesh": _mesh(result),
        "views": [_view(result, found.rotation, diagonal) for found in result.alternatives],
    }


def scene_html(result: PoseResult, made: Mapping[str, Any]) -> Markup:
    """Make the figure that `kfitScene` of `viewer.js` brings to life: canvas, a button for each pose, and words."""
    words = [view_words(result.front, found.rotation, result.translation) for found in result.alternatives]
    template = templates().get_template("scene.html")
    return Markup(template.render(result=result, words=words, mesh=made["mesh"] is not None))


def templates() -> Environment:
    """Return the environment of the reports' templates: strict on names, and escaping what goes in."""
    return Environment(
        loader=PackageLoader("kfit", "reports"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def _mesh(result: PoseResult) -> dict[str, str] | None:
    try:
        surface = None if result.surface is None else result.surface()
    except ValueError:  # the fitted volume is empty
        surface = None
    if surface is None:
        return None
    return {
        "vertices": _packed((surface.vertices.clip(-1, 1) * SHORT).round().astype("<i2")),
        "colors": _packed((surface.colors * 255).round().astype(np.uint8)),
        "faces": _packed(surface.faces.astype("<u4")),
    }


def _view(result: PoseResult, rotation: NDArray[np.float64], diagonal: float) -> dict[str, Any]:
    azimuth, elevation, roll = camera_angles(rotation, result.translation)
    place = -rotation.T @ result.translation / diagonal
    place *= min(1.0, FARTHEST / float(np.linalg.norm(place)))
    height, width = result.image.shape[:2]
    corners = np.array([[0, 0, 1], [width, 0, 1], [width, height, 1], [0, height, 1]]) - [0.5, 0.5, 0]
    rays = corners @ np.linalg.inv(result.intrinsics).T @ rotation
    pyramid = place + PYRAMID * rays / np.linalg.norm(rays, axis=1, keepdims=True)
    angles = {"azimuth": azimuth, "elevation": elevation, "roll": roll}
    return {
        **{name: round(angle, 2) for name, angle in angles.items()},
        "place": place.round(4).tolist(),
        "corners": pyramid.round(4).tolist(),
    }


def _packed(numbers: NDArray[Any]) -> str:
    return base64.b64encode(numbers.tobytes()).decode()
