"""The words for a pose: the command line, the app, the report, pictures and videos all take them from here."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray

from kfit.geometry import angles_from_rotation, from_opencv, viewing_ray_rotation
from kfit.pose import PoseResult

Level = Literal["high", "medium", "low"]
# Confidences from which a level begins. Answers with a doubtful mask or energy have at most a half: they are low.
HIGH, MEDIUM = 0.8, 0.5
# Angles in degrees below which nothing is worth a word.
LEVEL_VIEW, UPRIGHT, STRAIGHT = 3, 8, 82
SIDES = (
    "{} towards you",
    "{} towards you on the right",
    "{} on the right",
    "{} away from you on the right",
    "{} away from you",
    "{} away from you on the left",
    "{} on the left",
    "{} towards you on the left",
)
MEANINGS: dict[Level, str] = {
    "high": "Of such answers to held-out views at least four of five were right.",
    "medium": "Compare the drawing with the photo before you rely on it.",
    "low": "Do not rely on it: the pose may be wrong. A closer box, a mask or another photo may help.",
}


@dataclass(frozen=True)
class Words:
    """An answer in words.

    Attributes:
        name: name of the category.
        view: from where the camera sees the object, and where its front is.
        size: sides of the box, the front's side first, then the height.
        distance: from the camera.
        confidence: words for the confidence.
        level: level of the confidence.
        meaning: how a reader may use such an answer.
    """

    name: str
    view: str
    size: str
    distance: str
    confidence: str
    level: Level
    meaning: str

    def __str__(self) -> str:
        return f"{self.name} {self.view}; {self.size}, {self.distance}; {self.confidence}"


def words_of(result: PoseResult) -> Words:
    """Put an answer into words.

    Distances and sizes that rest on the category's mean size are "about".
    """
    sides = [float(side) for side in result.size]
    exact = result.size_from != "mean size"
    level = confidence_level(result.confidence, result.ambiguous)
    known = result.calibrated
    return Words(
        result.category,
        view_words(result.front, result.rotation, result.translation),
        lengths(sides),
        f"{'' if exact else 'about '}{length(float(result.translation[2]))} away",
        confidence_words(result.confidence, result.ambiguous) if known else "confidence not calibrated",
        level if known else "low",
        MEANINGS[level]
        if known
        else "The model was not calibrated for such a fit. Compare the drawing with the photo.",
    )


def describe(result: PoseResult) -> str:
    """Put an answer into one line."""
    return str(words_of(result))


def camera_angles(rotation: NDArray[np.float64], translation: NDArray[np.float64]) -> tuple[float, float, float]:
    """Azimuth, elevation and roll in degrees of the camera about the object, along the ray to its centre.

    The camera sits at −Rᵀt in the object's axes, of which y points up: (−cos e sin a, sin e, cos e cos a) times its
    distance.
    """
    place = torch.from_numpy(translation)
    ray = viewing_ray_rotation(place[:2] / place[2], torch.eye(3).to(place))
    angles = angles_from_rotation(from_opencv(ray.mT @ torch.from_numpy(rotation)))
    azimuth, elevation, roll = (math.degrees(float(angle)) for angle in angles)
    return azimuth, elevation, roll


def view_words(front: str | None, rotation: NDArray[np.float64], translation: NDArray[np.float64]) -> str:
    """Describe where the camera is about the object, where its front is if it has one, and how far it leans."""
    azimuth, elevation, roll = camera_angles(rotation, translation)
    words = [f"seen from {_height(elevation)}"]
    if front is not None:
        # The front is +x: it points sin(−a) towards the camera and cos a to its right.
        words.append(SIDES[round((azimuth + 90) / 45) % 8].format(front))
    if abs(roll) > 180 - UPRIGHT:
        words.append("upside down")
    elif abs(roll) > UPRIGHT:
        words.append(f"leaning {abs(roll):.0f}° to the {'left' if roll > 0 else 'right'}")
    return ", ".join(words)


def confidence_words(confidence: float, ambiguous: bool = False) -> str:
    """Describe the confidence of an answer, so that a low confidence reads low."""
    # Nothing is quite certain.
    share, level = f"{min(max(100 * confidence, 1), 99):.0f} %", confidence_level(confidence, ambiguous)
    if confidence <= MEDIUM:
        return f"unsure, only {share} likely to be within 20°"
    return f"{'only ' if level == 'medium' else ''}{share} sure to be within 20°{', ambiguous' if ambiguous else ''}"


def confidence_level(confidence: float, ambiguous: bool = False) -> Level:
    """Return the level of a confidence; an ambiguous answer's is never high."""
    if confidence <= MEDIUM:
        return "low"
    return "medium" if ambiguous or confidence < HIGH else "high"


def length(metres: float) -> str:
    """Write a length for people: centimetres, and metres from 100 cm on.

    >>> length(0.404), length(1.26)
    ('40 cm', '1.3 m')
    """
    return lengths([metres])


def lengths(metres: list[float]) -> str:
    """Write lengths of one thing in one unit.

    >>> lengths([0.12, 0.08, 0.094])
    '12 × 8 × 9 cm'
    """
    if max(metres) >= 0.995:
        return f"{' × '.join(f'{side:.1f}' for side in metres)} m"
    few = min(metres) < 0.0095  # a centimetre's tenths where a side would be read as 0 or 1
    return f"{' × '.join(f'{100 * side:.{int(few)}f}' for side in metres)} cm"


def _height(elevation: float) -> str:
    if abs(elevation) < LEVEL_VIEW:
        return "the side"
    where = "above" if elevation > 0 else "below"
    return f"straight {where}" if abs(elevation) > STRAIGHT else f"{abs(elevation):.0f}° {where}"
