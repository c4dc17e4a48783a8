"""Energies: how badly a picture explains an observation, and how unlikely a code is."""

from kfit.energies.code_prior import CodePrior
from kfit.energies.perceptual import Perceptual
from kfit.energies.pixel import L1, L2
from kfit.energies.silhouette import Silhouette, SoftIoU
from kfit.energies.ssim import SSIM

__all__ = ["L1", "L2", "SSIM", "CodePrior", "Perceptual", "Silhouette", "SoftIoU"]
