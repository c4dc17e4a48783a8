"""Covariances of answers, held against the errors of many noisy pictures."""

import math

import pytest
import torch

from kfit import FitPipeline
from kfit.core import SO3, Generator, Observation, Rendering, Variable
from kfit.energies import L1, L2
from kfit.fitting import answer_covariance
from kfit.initializers import Constant
from kfit.optimizers import LevenbergMarquardt


class Posed(Generator):
    """A cloud of points at a pose before a pinhole camera, its coordinates as a picture of two channels."""

    variables = {"rotation": Variable((3, 3), SO3()), "translation": Variable((3,))}  # noqa: RUF012

    def __init__(self):
        super().__init__()
        rng = torch.Generator().manual_seed(0)
        self.register_buffer("points", torch.randn(40, 3, generator=rng, dtype=torch.float64))

    def forward(self, rotation, translation):
        placed = self.points @ rotation.mT + translation[:, None]
        return Rendering((placed[..., :2] / placed[..., 2:]).mT[:, :, None])


ROTATION = SO3().to_value(torch.tensor([[0.2, -0.1, 0.3]], dtype=torch.float64))
TRANSLATION = torch.tensor([[0.1, -0.2, 6.0]], dtype=torch.float64)


def pipeline(energy=None):
    start = {"rotation": ROTATION[0].tolist(), "translation": TRANSLATION[0].tolist()}
    return FitPipeline(
        Posed(), {"l2": energy or L2()}, [Constant(start)], LevenbergMarquardt(), num_starts=1, num_steps=8
    )


def test_a_pose_s_covariance_is_that_of_its_errors_over_many_noisy_pictures():
    rng = torch.Generator().manual_seed(1)
    clean = Posed()(ROTATION, TRANSLATION).image
    noisy = clean + 0.01 * torch.randn(300, *clean.shape[1:], generator=rng, dtype=torch.float64)
    observation, fit = Observation(noisy), pipeline()
    result = fit(observation, seed=0)
    covariance = answer_covariance(fit, observation, result)
    turn = math.pi * SO3().to_raw(ROTATION.mT @ result.values["rotation"])
    error = torch.cat([turn, result.values["translation"] - TRANSLATION], 1)
    # Mahalanobis distances: a chi-square of 6 degrees of freedom.
    distance = (error[:, None] @ torch.linalg.solve(covariance, error[..., None]))[:, 0, 0]
    assert float(distance.mean()) == pytest.approx(6, abs=0.8)
    assert float((distance < 12.59).double().mean()) == pytest.approx(0.95, abs=0.04)
    empirical = error.T @ error / len(error)
    ratio = empirical.diagonal() / covariance.mean(0).diagonal()
    assert float(ratio.min()) > 0.75
    assert float(ratio.max()) < 1.33


def test_what_the_picture_does_not_fix_is_infinitely_uncertain():
    class Flat(Posed):
        def forward(self, rotation, translation):
            return Rendering(super().forward(rotation, 0 * translation + TRANSLATION).image)

    fit = pipeline()
    flat = FitPipeline(Flat(), {"l2": L2()}, fit.initializers, LevenbergMarquardt(), num_starts=1, num_steps=1)
    observation = Observation(Posed()(ROTATION, TRANSLATION).image + 0.01)
    assert bool(answer_covariance(flat, observation, flat(observation, seed=0)).isinf().all())


def test_energies_must_be_sums_of_squares():
    from kfit.optimizers import Adam

    observation = Observation(Posed()(ROTATION, TRANSLATION).image)
    fit = pipeline()
    absolute = FitPipeline(Posed(), {"l1": L1()}, fit.initializers, Adam(), num_starts=1, num_steps=1)
    with pytest.raises(ValueError, match="sums of squares"):
        answer_covariance(absolute, observation, absolute(observation, seed=0))
