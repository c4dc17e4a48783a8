"""Rigid maps (4, 4) that bring parts to their places."""

from __future__ import annotations

import numpy as np

FRONT_TO_X = np.array([[0.0, 0, 1, 0], [0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 0, 1]])
"""A quarter turn about y: what is built with its front at +z and seen with x to the right comes to face +x."""


def shift(x: float, y: float, z: float) -> np.ndarray:
    """A translation."""
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


def turn_x(angle: float) -> np.ndarray:
    """A right-handed turn about x by an angle in radians; π/2 brings y to z."""
    matrix = np.eye(4)
    matrix[1:3, 1:3] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    return matrix


def turn_y(angle: float) -> np.ndarray:
    """A right-handed turn about y by an angle in radians; π/2 brings z to x."""
    matrix = np.eye(4)
    matrix[0, [0, 2]] = np.cos(angle), np.sin(angle)
    matrix[2, [0, 2]] = -np.sin(angle), np.cos(angle)
    return matrix
