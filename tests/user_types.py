"""What a type checker sees of kfit in a user's script: ``.ci/run lint`` checks it against kfit as it is installed."""

from collections.abc import Mapping, Sequence
from typing import assert_type

import torch
from torch import Tensor

import kfit
from kfit.core import Evaluate, Evaluation, FitResult, Observation, Rendering, Variable, Variables
from kfit.energies import SSIM, CodePrior
from kfit.initializers import Constant


class Disc(kfit.Generator):
    """A generator that names its variables."""

    def __init__(self) -> None:
        super().__init__()
        self.variables = {"code": Variable((3,)), "angle": Variable()}

    def forward(self, code: Tensor, angle: Tensor) -> Rendering:
        return Rendering((code + angle.cos()[:, None])[..., None, None].expand(-1, -1, 16, 16))


class Descent(kfit.Optimizer):
    """An optimizer that needs gradients, and nothing to tell the type checker that they are there."""

    def init(self, raw: Variables, seeds: Tensor) -> None:
        return None

    def step(
        self, evaluate: Evaluate, raw: Variables, problem: Tensor, memory: None
    ) -> tuple[Variables, Evaluation, None]:
        found = evaluate(raw, problem, need="gradient")
        assert_type(found.gradient, Variables)
        return {name: tensor - 0.1 * found.gradient[name] for name, tensor in raw.items()}, found, None


def fit(energies: Mapping[str, SSIM], initializers: Sequence[Constant]) -> None:
    """Compose a fit and use its result."""
    generator = Disc()
    pipeline = kfit.FitPipeline(generator, energies, initializers, Descent(), num_starts=1, num_steps=1)
    picture = torch.rand(1, 3, 16, 16)
    result = pipeline(Observation(picture), seed=0)
    assert_type(result, FitResult)
    assert_type(result[0], FitResult)
    assert_type(generator(**result.values), Rendering)
    assert_type(pipeline.generator(**result.values).map(Tensor.double), Rendering)
    assert_type(SSIM()(picture, picture), Tensor)
    assert_type(CodePrior()(torch.zeros(1, 3)), Tensor)
    assert_type(Observation(picture)[0], Observation)


if __name__ == "__main__":
    fit({"look": SSIM()}, [Constant({"code": 0.0, "angle": 0.0})])
