"""Labels of objects in photos, and how far an answer is from them.

Directions are degrees in the image: 0 right, 90 up, counter-clockwise. A lean is by how much an axis of the object
comes out of the image plane towards the viewer.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kfit.geometry import CATEGORIES
from kfit.pose import PoseResult

# Degrees: by which directions may be off beyond the label's own tolerance, within which an axis without a direction
# points at the viewer or away, and from which it leans.
SLACK, AT_VIEWER, LEANS = 15.0, 30.0, 25.0
# A box drawn to this share of the photo's longer side from its edge may be cut there.
EDGE = 0.01
ROUND = ("bottle", "bowl", "can")
AXES = {"up": 1, "front": 0}


@dataclass(frozen=True)
class Label:
    """One object, labelled by eye.

    Attributes:
        name: name of the label.
        category: one of `kfit.geometry.CATEGORIES`.
        box: left, top, width, height in pixels of the upright photo.
        kind: "upright", "lying", "inverted", "occluded" or "odd".
        tolerance: degrees within which the label is right.
        either_end: whether it looks the same upside down.
        axes: axes "up" and "front", where labelled, direction, word ("toward", "away", "across") and lean, None each
            where unclear.
    """

    name: str
    category: str
    box: tuple[float, float, float, float]
    kind: str
    tolerance: float
    either_end: bool
    axes: Mapping[str, tuple[float | None, str | None, float | None]]

    @staticmethod
    def of(entry: Mapping[str, Any]) -> Label:
        """A label from its JSON.

        Raises:
            ValueError: for a category that is not kfit's, or an entry that lacks something.
        """
        try:
            if entry["category"] not in CATEGORIES:
                raise ValueError(f"label {entry['name']} has category {entry['category']!r}")
            axes = {
                axis: (entry.get(axis), entry.get(f"{axis}_toward"), entry.get(f"{axis}_lean"))
                for axis in AXES
                if axis in entry or f"{axis}_toward" in entry
            }
            left, top, width, height = map(float, entry["box"])
            return Label(
                name=str(entry["name"]),
                category=entry["category"],
                box=(left, top, width, height),
                kind=str(entry["kind"]),
                tolerance=float(entry["tolerance"]),
                either_end=bool(entry.get("either_end", False)),
                axes=axes,
            )
        except KeyError as error:
            raise ValueError(f"label {entry.get('name', '')!r} lacks {error}") from None


def read_labels(folder: str | Path) -> dict[Path, list[Label]]:
    """Photos of a folder with labels.json, each with its labels.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: if it holds no labels.
    """
    file = Path(folder) / "labels.json"
    if not file.is_file():
        raise FileNotFoundError(f"{folder} holds no labels.json")
    try:
        photos = json.loads(file.read_text())["photos"]
        return {Path(folder) / photo["file"]: [Label.of(entry) for entry in photo["objects"]] for photo in photos}
    except (json.JSONDecodeError, KeyError, TypeError) as error:
        raise ValueError(f"{file} holds no labels of photos: {error}") from None


def faults(label: Label, result: PoseResult) -> list[str]:
    """What of an answer contradicts the label, beyond its tolerance and 15°; nothing where it is right."""
    found = []
    for axis, (direction, word, lean) in label.axes.items():
        either = axis == "up" and label.either_end
        found_direction, found_lean = _axis(result, AXES[axis])
        if direction is not None:
            off = 180.0 if found_direction is None else abs((found_direction - direction + 180) % 360 - 180)
            off = min(off, 180 - off) if either else off
            if off > label.tolerance + SLACK:
                found.append(f"{axis} {off:.0f}° off")
        if lean is not None:
            found_lean, lean = (abs(found_lean), abs(lean)) if either else (found_lean, lean)
            beyond = abs(found_lean - lean) - label.tolerance
        else:
            beyond = _contradiction(word, found_lean, direction is None, either)
        if beyond > SLACK:
            found.append(f"{axis} leans {found_lean:.0f}° to the viewer")
    return found


def _contradiction(word: str | None, lean: float, without_direction: bool, either: bool) -> float:
    """Degrees by which a lean contradicts a word."""
    if word is None:
        return 0.0
    if word == "across":
        return abs(lean) - LEANS
    along = abs(lean) if either else lean if word == "toward" else -lean
    return (90 - AT_VIEWER if without_direction else LEANS) - along


def _axis(result: PoseResult, axis: int) -> tuple[float | None, float]:
    """Direction in the image of an object's axis, None where it has none, and its lean, in degrees."""
    tip = result.translation + result.rotation[:, axis] * result.size[axis] / 2
    ends = [point @ result.intrinsics.T for point in (result.translation, tip)]
    lean = np.degrees(np.arcsin(np.clip(result.rotation[:, axis] @ -_unit(result.translation), -1, 1)))
    if min(end[2] for end in ends) <= 0:
        return None, float(lean)
    right, down = ends[1][:2] / ends[1][2] - ends[0][:2] / ends[0][2]
    return (None if right == down == 0 else float(np.degrees(np.arctan2(-down, right)))), float(lean)


def box_iou(label: Label, result: PoseResult) -> float:
    """IoU of the drawn box with that around the projected 3D box, of which what such an object fills counts.

    That is of bottles, bowls and cans the inscribed cylinder, of mugs a cylinder and a handle, of laptops the base and
    the lid's upper edge. Where the drawn box is cut by the photo's edge, the other is cut too.
    """
    points = _filled(result.category, result.size) @ result.rotation.T + result.translation
    if points[:, 2].min() <= 0:
        return 0.0
    flat = points @ result.intrinsics.T
    flat = flat[:, :2] / flat[:, 2:]
    height, width = result.image.shape[:2]
    limits = np.array([0.0, 0.0, width, height])
    drawn = np.array([*label.box[:2], label.box[0] + label.box[2], label.box[1] + label.box[3]])
    found_box = np.concatenate([flat.min(0), flat.max(0)])
    cut = np.abs(drawn - limits) <= EDGE * max(width, height)
    cut |= np.array([*(drawn[:2] < limits[:2]), *(drawn[2:] > limits[2:])])
    inside = np.concatenate([np.maximum(found_box[:2], limits[:2]), np.minimum(found_box[2:], limits[2:])])
    return overlap(np.where(cut, inside, found_box), drawn)


def _filled(category: str, size: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points (N, 3) of the object's frame around what an object of a category fills of its box."""
    x, y, z = size / 2
    turn = np.linspace(0, 2 * np.pi, 91)[:-1]
    if category in ROUND or category == "mug":
        radius_x, radius_z = (x, z) if category in ROUND else (min(x, z), min(x, z))
        middle = 0.0 if category in ROUND else radius_x - x
        ring = np.stack([middle + radius_x * np.cos(turn), np.zeros(90), radius_z * np.sin(turn)], 1)
        body = np.concatenate([ring - np.array([0, y, 0]), ring + np.array([0, y, 0])])
        handle = [(x, -y / 2, 0), (x, y / 2, 0)] if category == "mug" else np.zeros((0, 3))
        return np.concatenate([body, handle])
    corners = np.array([(a, b, c) for a in (-x, x) for b in (-y, y) for c in (-z, z)])
    above_front = (corners[:, 0] > 0) & (corners[:, 1] > 0)
    return corners[~above_front] if category == "laptop" else corners


def overlap(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """IoU of two boxes, left, top, right, bottom."""
    common = np.prod((np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2])).clip(0))
    return float(common / (np.prod(a[2:] - a[:2]) + np.prod(b[2:] - b[:2]) - common))


def _unit(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    return vector / np.linalg.norm(vector)
