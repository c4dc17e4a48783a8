"""Energies of pictures, and priors on a code, a pose, a lens or a field."""

from kfit.energies import functional
from kfit.energies.code_prior import CodePrior
from kfit.energies.depth import Depth
from kfit.energies.gradient import Gradient
from kfit.energies.learned_score import LearnedScore
from kfit.energies.lens_prior import LensPrior
from kfit.energies.local_ncc import LocalNCC
from kfit.energies.lpips import LPIPS
from kfit.energies.ms_ssim import MSSSIM
from kfit.energies.mutual_information import MutualInformation
from kfit.energies.ncc import NCC
from kfit.energies.perceptual import Perceptual
from kfit.energies.pixel import L1, L2
from kfit.energies.pose_prior import PosePrior
from kfit.energies.psnr import PSNR
from kfit.energies.pyramid import Pyramid, ResidualPyramid
from kfit.energies.robust import Cauchy, Charbonnier, GemanMcClure, Huber, Welsch
from kfit.energies.silhouette import Dice, Silhouette, SoftIoU
from kfit.energies.smoothness import BendingEnergy, TotalVariation
from kfit.energies.ssim import SSIM

__all__ = [
    "L1",
    "L2",
    "LPIPS",
    "MSSSIM",
    "NCC",
    "PSNR",
    "SSIM",
    "BendingEnergy",
    "Cauchy",
    "Charbonnier",
    "CodePrior",
    "Depth",
    "Dice",
    "GemanMcClure",
    "Gradient",
    "Huber",
    "LearnedScore",
    "LensPrior",
    "LocalNCC",
    "MutualInformation",
    "Perceptual",
    "PosePrior",
    "Pyramid",
    "ResidualPyramid",
    "Silhouette",
    "SoftIoU",
    "TotalVariation",
    "Welsch",
    "functional",
]
