"""Energies at work: each finds by how far a photo was moved, a corner hidden."""

import pytest
import torch
from kornia.geometry.transform import translate
from skimage.data import astronaut
from torch import nn

from kfit import FitPipeline
from kfit.core import Generator, Observation, Rendering, Variable
from kfit.energies import (
    L1,
    MSSSIM,
    NCC,
    SSIM,
    Cauchy,
    Charbonnier,
    Depth,
    GemanMcClure,
    Gradient,
    Huber,
    LocalNCC,
    MutualInformation,
    Perceptual,
    Pyramid,
    Welsch,
)
from kfit.features import Activations
from kfit.fitting.schedules import Linear
from kfit.initializers import Uniform
from kfit.optimizers import Adam

MOVED = torch.tensor([[2.0, -1.5]])


def photo():
    picture = torch.from_numpy(astronaut())[:128, 160:288].permute(2, 0, 1)[None] / 255
    return nn.functional.interpolate(picture, (32, 32), mode="bilinear", antialias=True)


class Moved(Generator):
    """A photo moved by some pixels; its first channel stands for depth."""

    def __init__(self):
        super().__init__()
        self.register_buffer("picture", photo())
        self.variables = {"pixels": Variable((2,))}

    def forward(self, pixels):
        image = translate(self.picture.expand(len(pixels), -1, -1, -1), pixels, padding_mode="border")
        return Rendering(image=image, depth=image[:, :1])


def observation():
    drawn = Moved()(pixels=MOVED)
    weight = torch.ones(1, 1, 32, 32)
    weight[..., 20:, 24:] = 0
    hidden = weight == 0
    return Observation(drawn.image.masked_fill(hidden, 0.0), depth=drawn.depth.masked_fill(hidden, 9.0), weight=weight)


def pipeline(energies, **settings):
    return FitPipeline(
        Moved(), energies, [Uniform("pixels", -4.0, 4.0)], Adam(0.3), num_starts=6, num_steps=40, **settings
    )


def networks():
    torch.manual_seed(3)
    return nn.Sequential(nn.Conv2d(3, 8, 5, 2, 2), nn.ReLU(), nn.Conv2d(8, 8, 3, 1, 1))


@pytest.mark.parametrize(
    "energy",
    [Depth(), Welsch(), SSIM(), NCC(), MutualInformation(16), Perceptual(Activations(networks(), ["0", "2"]))],
    ids=lambda energy: type(energy).__name__,
)
def test_each_finds_the_move(energy):
    finds_the_move(energy)


@pytest.mark.slow
@pytest.mark.parametrize(
    "energy",
    [
        Charbonnier(), Huber(), Cauchy(), GemanMcClure(), MSSSIM(), Gradient(), LocalNCC(), Pyramid(L1()),
        Pyramid(SSIM(5), 2),
    ],
    ids=lambda energy: type(energy).__name__,
)  # fmt: skip
def test_their_variants_find_the_move_too(energy):
    finds_the_move(energy)


def finds_the_move(energy):
    found = pipeline({"seen": energy})(observation(), seed=0)
    torch.testing.assert_close(found.values["pixels"], MOVED, rtol=0, atol=0.25)


class Watched(MutualInformation):
    graphs: list[bool]

    def compare(self, prediction, prepared):
        self.graphs.append(torch.is_grad_enabled())
        return super().compare(prediction, prepared)


def test_one_that_only_ranks_decides_the_winner_and_is_never_differentiated():
    ranker = Watched(16)
    Watched.graphs = []
    plain = pipeline({"seen": L1()})(observation(), seed=0)
    made = pipeline({"seen": L1(), "rank": ranker}, weights={"rank": 0.0}, rank_weights={"rank": 1.0})
    ranked = made(observation(), seed=0)
    torch.testing.assert_close(ranked.history.values["pixels"], plain.history.values["pixels"], rtol=0, atol=0)
    torch.testing.assert_close(ranked.energy, ranked.history.terms["rank"].amin((0, 2)))
    assert len(Watched.graphs) == 41
    assert not any(Watched.graphs)


def test_a_coarse_term_that_fades_lets_a_fine_one_settle():
    energies = {"far": Pyramid(L1(), 4), "near": Cauchy(0.05)}
    made = pipeline(energies, weights={"far": Linear(1, 0), "near": Linear(0, 1)})
    torch.testing.assert_close(made(observation(), seed=0).values["pixels"], MOVED, rtol=0, atol=0.1)
