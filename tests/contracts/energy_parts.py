"""How the contracts' tests build every shipped energy and prior, and what they compare."""

import copy
import functools
import tempfile
from pathlib import Path

import pytest
import torch
from torch import nn
from walk import shipped

import kfit.energies
from kfit.core import Observation
from kfit.energies import (
    L1,
    L2,
    LPIPS,
    MSSSIM,
    NCC,
    PSNR,
    SSIM,
    BendingEnergy,
    Cauchy,
    Charbonnier,
    CodePrior,
    Depth,
    Dice,
    GemanMcClure,
    Gradient,
    Huber,
    LocalNCC,
    MutualInformation,
    Perceptual,
    PosePrior,
    Pyramid,
    ResidualPyramid,
    Silhouette,
    SoftIoU,
    TotalVariation,
    Welsch,
)
from kfit.features import Activations
from kfit.generators import PoseHead, RotationHead


def features():
    torch.manual_seed(1)
    return nn.Sequential(nn.Conv2d(3, 4, 3, 2, 1), nn.Softplus(), nn.Conv2d(4, 3, 3, 1, 1))


@functools.cache
def lpips():
    """LPIPS on an AlexNet of random weights."""
    torch.manual_seed(1)
    state = {}
    for number, channels, width, kernel in ((0, 3, 64, 11), (3, 64, 192, 5), (6, 192, 384, 3), (8, 384, 256, 3)):
        state[f"features.{number}.weight"] = torch.randn(width, channels, kernel, kernel) / (channels**0.5 * kernel)
        state[f"features.{number}.bias"] = 0.1 * torch.randn(width)
    state["features.10.weight"] = torch.randn(256, 256, 3, 3) / 48
    state["features.10.bias"] = 0.1 * torch.randn(256)
    with tempfile.TemporaryDirectory() as folder:
        torch.save(state, Path(folder) / "alexnet.pth")
        return LPIPS(weights=str(Path(folder) / "alexnet.pth"))


BUILD = {
    L1: [L1],
    L2: [L2],
    Charbonnier: [Charbonnier],
    Huber: [Huber, lambda: Huber(scale=10)],
    Cauchy: [Cauchy],
    GemanMcClure: [GemanMcClure],
    Welsch: [lambda: Welsch(scale=0.5)],
    SSIM: [SSIM],
    MSSSIM: [lambda: MSSSIM(num_scales=2, window_size=3), lambda: MSSSIM(window_size=5)],
    Gradient: [Gradient],
    NCC: [NCC],
    LocalNCC: [lambda: LocalNCC(5), LocalNCC],
    MutualInformation: [lambda: MutualInformation(num_bins=8)],
    Pyramid: [lambda: Pyramid(L1()), lambda: Pyramid(SoftIoU(), 2), lambda: Pyramid(Perceptual(features()), 2)],
    ResidualPyramid: [lambda: ResidualPyramid(L2()), lambda: ResidualPyramid(Cauchy(), 2)],
    Perceptual: [
        lambda: Perceptual(features()),
        lambda: Perceptual(features(), squared=False),
        lambda: Perceptual(Activations(features(), ["0", "2"])),
    ],
    LPIPS: [lambda: copy.deepcopy(lpips())],
    Silhouette: [Silhouette],
    SoftIoU: [SoftIoU],
    Depth: [Depth],
    Dice: [Dice],
    PSNR: [PSNR],
    CodePrior: [CodePrior],
    TotalVariation: [lambda: TotalVariation("field")],
    BendingEnergy: [lambda: BendingEnergy("field")],
    PosePrior: [lambda: PosePrior(head()), lambda: PosePrior(head("y")), lambda: PosePrior(upright_head())],
}
CHANNELS = {"image": 3, "mask": 1, "depth": 1}
# LPIPS needs pictures of 31 pixels; a soft histogram blurs even a picture against itself
SIZE = {LPIPS: 31}
NOT_ZERO = (MutualInformation, PSNR)


def built(kind):
    return [
        pytest.param(build, id=f"{found.__name__}-{number}")
        for found in sorted(shipped(kfit.energies, kind), key=lambda found: found.__name__)
        for number, build in enumerate(BUILD.get(found, []))
    ]


def pictures(energy, rows=2, seed=0, dtype=torch.float64):
    rng = torch.Generator().manual_seed(seed)
    size = SIZE.get(type(energy), 8)
    shape = (rows, CHANNELS[energy.on], size, size)
    return [0.1 + 0.8 * torch.rand(shape, generator=rng, dtype=dtype) for _ in range(2)]


def weights(energy, rows=2, dtype=torch.float64):
    size = SIZE.get(type(energy), 8)
    weight = torch.rand(rows, 1, size, size, generator=torch.Generator().manual_seed(5), dtype=dtype)
    weight[:, :, size // 4 : 5 * size // 8, 3 * size // 8 :] = 0
    return weight


def hard_pictures(energy, dtype):
    """White, black, grey, one dark pixel, any, two that differ from these by a rounding, and two out of range."""
    anything = pictures(energy, rows=1, dtype=dtype)[0]
    plain = [torch.full_like(anything, tone) for tone in (1.0, 0.0, 0.5)]
    point = plain[0].clone()
    point[..., 3, 3] = 0
    return torch.cat([*plain, point, anything, plain[2] + 1e-7, anything + 1e-6, 1e4 * anything, -anything])


def head(symmetry="none"):
    torch.manual_seed(3)
    return RotationHead(symmetry, channels=(4, 4), hidden_dim=8, bin_deg=60, sigma_deg=30, image_size=8)


def upright_head():
    torch.manual_seed(3)
    return PoseHead(channels=(4, 4), hidden_dim=8, image_size=8)


def asked(prior, dtype=torch.float32):
    """Values of a prior's variables for three rows, and what it has read off their pictures."""
    shape = (2, 4, 4) if prior.on == "field" else (4,)
    rng = torch.Generator().manual_seed(1)
    angles = torch.linspace(-1, 2, 3, dtype=dtype)
    if isinstance(prior.on, str):
        value = 3 * torch.rand(3, *shape, generator=rng, dtype=dtype) - 1
    else:
        value = {name: angles / (i + 1) for i, name in enumerate(prior.on)}
    rng = torch.Generator().manual_seed(0)
    return value, prior.prepare(Observation(torch.rand(3, 3, 8, 8, generator=rng, dtype=dtype)))
