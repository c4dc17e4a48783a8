"""The pose of an object in the photo's camera from its fitted values."""

from __future__ import annotations

import torch
from torch import Tensor

from kfit.core import Variables
from kfit.geometry import Crop, diagonal_at, pose_from_crop, with_focal
from kfit.pose.card import Card


def placement(fitted: Variables, crop: Crop, camera: Tensor, card: Card) -> tuple[Tensor, Tensor, Tensor]:
    """Return rotation (1, 3, 3), translation (1, 3) and box diagonal (1,) in metres in the photo's camera.

    The diagonal is the fitted one with several cameras, follows from the fitted distance with depth, and is the
    category's mean otherwise.

    Args:
        fitted: one problem's values; a fitted focal length replaces the camera's.
        crop: the fitted square.
        camera: (3, 3) of the photo.
        card: card of the model.
    """
    values = {name: value.double() for name, value in fitted.items()}
    camera = camera.double()
    if "focal" in values:
        camera = with_focal(camera, values["focal"] * crop.side)
    angles = (values["azimuth"], values["elevation"], values["roll"])
    shift, scale = values["shift"], values["scale"]
    diagonal = torch.tensor([card.mean_diagonal], dtype=torch.float64)
    if "diagonal" in values:
        diagonal = values["diagonal"]
    elif "distance" in values:
        diagonal = diagonal_at(values["distance"], shift, scale, crop, camera, card.unit_fraction)
    return *pose_from_crop(*angles, shift, scale, crop, camera, diagonal, card.unit_fraction), diagonal
