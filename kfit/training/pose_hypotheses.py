"""Pictures of objects with poses that may be wrong: what a refiner learns from."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor

from kfit.core import Encoder, Generator
from kfit.generators import SimilarityWarp
from kfit.geometry import Symmetry, angles_from_rotation, focal_by_distance, rotation_error, rotation_from_angles
from kfit.geometry.refiner_network import PoseUpdate, refiner_input, rotation_update, updated_rotation
from kfit.training.refiner_rows import RefinerRows

# Shares of hypotheses near the truth and of those that are flipped; the others have any rotation.
NEAR, FLIPPED = 0.6, 0.25
# Largest angles from the truth, and from a flip of it.
NEAR_DEG, FLIPPED_DEG = 32.0, 15.0
# Standard deviations of shift and log scale from the truth, and of the logarithm of the focal length.
SHIFT, LOG_SCALE, LOG_FOCAL = 0.06, 0.08, 0.15


class Hypotheses(NamedTuple):
    """Pictures with true poses and with poses that may be wrong.

    Attributes:
        observed: (N, 4, S, S) pictures and masks.
        rotation, shift, log_scale: the truth, (N, 3, 3), (N, 2) and (N,).
        at_rotation, at_shift, at_log_scale: the hypotheses.
        code: (N, D).
        focal: (N,) focal lengths over the width of the pictures.
        visible: (N, 1, S, S), 0 where something known hides the object.
    """

    observed: Tensor
    rotation: Tensor
    shift: Tensor
    log_scale: Tensor
    at_rotation: Tensor
    at_shift: Tensor
    at_log_scale: Tensor
    code: Tensor
    focal: Tensor
    visible: Tensor

    @staticmethod
    def sample(
        observed: Tensor, rotation: Tensor, shift: Tensor, log_scale: Tensor, distance: Tensor,
        visible: Tensor, encoder: Encoder, unit_fraction: float,
    ) -> Hypotheses:  # fmt: skip
        """Choose codes and hypotheses for pictures (N, 4, S, S) of known poses at known distances in box diagonals.

        Codes are the encoder's mean or, for half of the pictures, drawn from its Gaussian. Half of the shifts and
        scales are those at which a fit starts, the others lie around the truth.
        """
        mean, log_variance = encoder(observed[:, :3])
        half = (torch.rand(4, len(observed), device=observed.device) < 0.5).to(mean)
        code = mean + half[0, :, None] * (log_variance / 2).exp() * torch.randn_like(mean)
        at_shift = half[1, :, None] * (shift + SHIFT * torch.randn_like(shift))
        at_log_scale = half[2] * (log_scale + LOG_SCALE * torch.randn_like(log_scale))
        focal = focal_by_distance(distance, unit_fraction) * log_scale.exp()
        focal = focal * (LOG_FOCAL * half[3] * torch.randn_like(focal)).exp()
        truth, at = (rotation, shift, log_scale), (random_hypotheses(rotation), at_shift, at_log_scale)
        return Hypotheses(observed, *truth, *at, code, focal, visible)

    def select(self, rows: Tensor) -> Hypotheses:
        """Those of the numbers ``rows``."""
        return Hypotheses(*(tensor[rows] for tensor in self))

    def join(self, other: Hypotheses) -> Hypotheses:
        """These and others."""
        return Hypotheses(*map(torch.cat, zip(self, other, strict=True)))

    def draw(self, generator: Generator, symmetry: Symmetry) -> RefinerRows:
        """Draw the hypotheses, and compute what a refiner is to predict."""
        azimuth, elevation, roll = angles_from_rotation(self.at_rotation)
        angles = {"azimuth": azimuth, "elevation": elevation, "roll": roll}
        place = {"shift": self.at_shift, "scale": self.at_log_scale.exp()}
        lens = {"focal": self.focal} if "focal" in generator.variables else {}
        drawn = SimilarityWarp(generator)(code=self.code, **angles, **place, **lens)
        if drawn.mask is None:
            raise ValueError("a refiner learns from generators that draw masks, this one draws none")
        return RefinerRows(
            observed=self.observed,
            drawn=refiner_input(drawn.image, drawn.mask, self.visible),
            up=self.at_rotation[:, :, 1],
            rotation=rotation_update(self.at_rotation, self.rotation, symmetry),
            shift=self.shift - self.at_shift,
            log_scale=self.log_scale - self.at_log_scale,
            error=rotation_error(self.at_rotation, self.rotation, symmetry),
            free_turn=torch.full_like(azimuth, float(symmetry == "y")),
        )

    def advance(self, update: PoseUpdate) -> Hypotheses:
        """Return the hypotheses after a refiner's update."""
        return self._replace(
            at_rotation=updated_rotation(self.at_rotation, update.rotation),
            at_shift=(self.at_shift + update.shift).clamp(-1, 1),
            at_log_scale=(self.at_log_scale + update.log_scale).clamp(-1, 1),
        )


def random_hypotheses(rotation: Tensor) -> Tensor:
    """Rotations (N, 3, 3) near the true ones, flipped, or of any kind, drawn from torch's random numbers.

    60 % are up to 32° off about any axis, 25 % are turned by half or a quarter about the object's vertical axis or
    upside-down and up to 15° off, and the others are uniform.
    """
    rows = rotation.new_zeros(len(rotation))
    kind, number = torch.rand_like(rows), torch.randint(5, rows.shape, device=rows.device)
    # About y, x and z by half, about y by a quarter to either side.
    azimuth = rows.new_tensor([1.0, 0.0, 0.0, 0.5, -0.5])[number] * math.pi
    elevation = rows.new_tensor([0.0, 1.0, 0.0, 0.0, 0.0])[number] * math.pi
    roll = rows.new_tensor([0.0, 0.0, 1.0, 0.0, 0.0])[number] * math.pi
    flip = rotation_from_angles(azimuth, elevation, roll)
    near = kind < NEAR
    base = torch.where(near[:, None, None], rotation, rotation @ flip)
    axis = torch.nn.functional.normalize(torch.randn_like(rotation[:, 0]), dim=1)
    angle = torch.rand_like(rows) * torch.where(near, math.radians(NEAR_DEG), math.radians(FLIPPED_DEG))
    anything = torch.linalg.qr(torch.randn_like(rotation)).Q
    anything = anything * torch.linalg.det(anything)[:, None, None]
    off = updated_rotation(base, axis * angle[:, None])
    return torch.where((kind < NEAR + FLIPPED)[:, None, None], off, anything)
