"""Gradients of answers by the pictures that were fitted."""

import pytest
import torch

from kfit import FitPipeline
from kfit.core import SO3, Generator, Observation, Rendering, Variable
from kfit.energies import L2
from kfit.fitting.implicit import differentiable_answer
from kfit.generators import Template
from kfit.initializers import Constant
from kfit.optimizers import LevenbergMarquardt


class Rotated(Generator):
    """Three bent numbers of a rotation's columns, as a picture."""

    variables = {"rotation": Variable((3, 3), SO3()), "light": Variable()}  # noqa: RUF012

    def forward(self, rotation, light):
        return Rendering((rotation + 0.3 * rotation.square() + light[:, None, None])[:, None])


def fit_of(generator, starts, num_steps=25):
    return FitPipeline(
        generator, {"l2": L2()}, [Constant(starts)], LevenbergMarquardt(1e-6), num_starts=1, num_steps=num_steps
    )


def answers(pipeline, name):
    def answer(target):
        result = pipeline(Observation(target.detach()), seed=0)
        return differentiable_answer(pipeline, Observation(target), result)[name]

    return answer


@pytest.mark.parametrize("along", ["any direction", pytest.param("each pixel", marks=pytest.mark.slow)])
def test_a_rotation_s_gradient_is_that_of_finite_differences(along):
    rotation = SO3().to_value(torch.tensor([[0.1, 0.2, -0.1]], dtype=torch.float64))
    noise = 0.05 * torch.randn(1, 1, 3, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    target = Rotated()(rotation, torch.tensor([0.3], dtype=torch.float64)).image + noise
    pipeline = fit_of(Rotated(), {"rotation": torch.eye(3).tolist(), "light": 0.0})
    for name in ("rotation", "light"):
        photo, fast = target.clone().requires_grad_(), along == "any direction"
        assert torch.autograd.gradcheck(answers(pipeline, name), photo, eps=1e-5, atol=1e-5, fast_mode=fast)


def test_a_registration_s_gradient_is_that_of_finite_differences():
    grid = torch.linspace(-2, 2, 10, dtype=torch.float64)
    picture = (torch.outer(grid.sin(), (1.3 * grid).cos()) / 2 + 0.5)[None]
    template = Template(picture, "similarity")
    values = {"roll": [0.05], "shift": [[0.07, -0.03]], "scale": [1.04]}
    target = template(**{k: torch.tensor(v, dtype=torch.float64) for k, v in values.items()}).image
    pipeline = fit_of(template, {"roll": 0.0, "shift": 0.0, "scale": 1.0})
    assert torch.autograd.gradcheck(
        answers(pipeline, "shift"), target.clone().requires_grad_(), eps=1e-5, atol=1e-4, fast_mode=True
    )


def test_an_answer_that_is_no_minimum_is_refused():
    target = Rotated()(torch.eye(3, dtype=torch.float64)[None], torch.zeros(1, dtype=torch.float64)).image
    flat = Observation(torch.full_like(target, 0.5))
    pipeline = fit_of(Template(torch.full_like(target[0], 0.5), "translation"), {"shift": 0.0}, 1)
    with pytest.raises(ValueError, match="does not rise in every direction"):
        differentiable_answer(pipeline, flat, pipeline(flat, seed=0))


def test_too_many_unknowns_are_refused():
    class Large(Generator):
        variables = {"pixels": Variable((20, 20))}  # noqa: RUF012

        def forward(self, pixels):
            return Rendering(pixels[:, None])

    target = Observation(torch.zeros(1, 1, 20, 20))
    pipeline = fit_of(Large(), {"pixels": 0.0}, 0)
    with pytest.raises(ValueError, match="400 unknowns is too large"):
        differentiable_answer(pipeline, target, pipeline(target, seed=0))
