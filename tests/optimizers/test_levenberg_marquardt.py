"""Levenberg–Marquardt by products with the Jacobian, for many unknowns."""

import pytest
import torch

from kfit import FitPipeline
from kfit.core import Generator, Observation, Rendering, Variable
from kfit.energies import L1, L2
from kfit.generators import Template
from kfit.initializers import Constant, Uniform
from kfit.optimizers import LevenbergMarquardt, levenberg_marquardt


class Blurred(Generator):
    """A picture of unknown pixels, bent and blurred: every residual depends on many unknowns."""

    variables = {"pixels": Variable((32, 32))}  # noqa: RUF012

    def forward(self, pixels):
        kernel = torch.ones(1, 1, 3, 3, dtype=pixels.dtype) / 9
        return Rendering(torch.nn.functional.conv2d(pixels[:, None] + pixels[:, None].sin(), kernel, padding=1))


def fit(energy=None, num_steps=6):
    pixels = torch.rand(2, 32, 32, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    pipeline = FitPipeline(
        Blurred(),
        {"l2": energy or L2()},
        [Constant({"pixels": 0.0})],
        LevenbergMarquardt(1e-6),
        num_starts=1,
        num_steps=num_steps,
    )
    return pipeline(Observation(Blurred()(pixels).image), seed=0)


def test_a_thousand_unknowns_take_few_drawings():
    result = fit()
    assert float((result.energy / result.history.energy[0, :, 0]).max()) < 1e-4
    assert result.num_evaluations < 2 * 6 * 8


def test_each_row_walks_as_if_it_were_alone_and_none_rises():
    result = fit(num_steps=3)
    assert bool((result.history.energy.diff(dim=0) < 0).all())
    pixels = torch.rand(2, 32, 32, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    alone = FitPipeline(
        Blurred(), {"l2": L2()}, [Constant({"pixels": 0.0})], LevenbergMarquardt(1e-6), num_starts=1, num_steps=3
    )(Observation(Blurred()(pixels[:1]).image), seed=0)
    torch.testing.assert_close(result.values["pixels"][:1], alone.values["pixels"], rtol=1e-9, atol=1e-9)


@pytest.mark.slow
def test_products_and_differences_find_the_same_registration(monkeypatch):
    grid = torch.linspace(-2, 2, 24, dtype=torch.float64)
    picture = torch.stack([torch.outer((k * grid).sin(), (grid + k).cos()) for k in (1, 2, 3)]) / 2 + 0.5
    truth = torch.tensor([[[0.04, -0.06], [-0.02, 0.05], [0.03, 0.01], [0.0, -0.03]]], dtype=torch.float64)
    observed = Observation(Template(picture, oversampling=3)(corners=truth).image)
    ends = []
    for most in (64, 0):
        monkeypatch.setattr(levenberg_marquardt, "MAX_DIFFERENCES", most)
        pipeline = FitPipeline(
            Template(picture, oversampling=3),
            {"l2": L2()},
            [Uniform("corners", -0.02, 0.02)],
            LevenbergMarquardt(),
            num_starts=3,
            num_steps=15,
        )
        ends.append(pipeline(observed, seed=0).values["corners"])
    torch.testing.assert_close(ends[0], truth, rtol=0, atol=1e-4)
    torch.testing.assert_close(ends[1], truth, rtol=0, atol=1e-4)


def test_products_too_need_sums_of_squares():
    with pytest.raises(ValueError, match="sums of squares"):
        fit(L1())
