"""One value for all starts, with optional noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import torch
from torch import Tensor

from kfit.core import Initializer, Observation, Variable, Variables
from kfit.core.check import check_dict, check_names, check_range


class Constant(Initializer):
    """Start each variable at one value, or scattered around it.

    Args:
        values: by variable; a number fills the variable's whole shape, a list must match it.
        sigma: standard deviation of all starts but the first, by variable, as steps in the variable's space:
            half-turns for angles and rotations, logarithms for positive numbers; 0 for variables not named.

    Raises:
        TypeError, ValueError: if a value is not finite, if a sigma is below 0 or of a variable that has no value here,
            and, when called, if a value has another shape than its variable.

    Example:
        >>> import torch
        >>> from kfit.core import Observation, Positive, Variable
        >>> from kfit.initializers import Constant
        >>> start = Constant({"scale": 1.0}, sigma={"scale": 0.1})
        >>> observation, rng = Observation(torch.ones(1, 3, 64, 64)), torch.Generator().manual_seed(0)
        >>> start({"scale": Variable((), Positive())}, observation, 3, [rng])["scale"]
        tensor([1.0000, 0.9711, 0.8042])
    """

    def __init__(self, values: dict[str, float | list[float]], sigma: dict[str, float] | None = None) -> None:
        check_dict("Constant: values", values, _check_finite)
        self.values, self.sigma, self.on = values, {} if sigma is None else sigma, tuple(values)
        check_dict("Constant: sigma", self.sigma, check_range, 0)
        check_names("Constant: sigma", self.sigma, self.on)

    def __call__(
        self,
        variables: Mapping[str, Variable],
        observation: Observation,
        num_starts: int,
        rngs: Sequence[torch.Generator],
    ) -> Variables:
        started = {}
        for name, value in self.values.items():
            tensor, shape = torch.as_tensor(value, dtype=observation.image.dtype), variables[name].shape
            if tensor.dim() and tensor.shape != shape:
                raise ValueError(f"Constant: {name} must be a number or of shape {shape}, got {tuple(tensor.shape)}")
            same = tensor.expand(observation.num_problems, *shape)
            if name in self.sigma:
                started[name] = scattered(same, variables[name], self.sigma[name], num_starts, rngs)
            else:
                started[name] = same.repeat_interleave(num_starts, 0)
        return started


def scattered(
    values: Tensor, variable: Variable, sigma: float, num_starts: int, rngs: Sequence[torch.Generator]
) -> Tensor:
    """Scatter B values into (B · S, \\*shape) by steps of sigma · ε, ε ~ N(0, 1); the first starts stay."""
    space, shape = variable.space, variable.raw_shape
    noise = torch.stack([torch.randn(num_starts, *shape, generator=rng, dtype=torch.float32) for rng in rngs]).to(
        values
    )
    noise[:, 0] = 0
    raw = space.to_raw(values).repeat_interleave(num_starts, 0)
    return space.to_value(space.retract(raw, sigma * noise.flatten(0, 1)))


def _check_finite(name: str, value: Any) -> None:
    """Refuse anything but finite numbers and lists or tensors of them."""
    if isinstance(value, Tensor | list | tuple):
        for one in value.flatten().tolist() if isinstance(value, Tensor) else value:
            _check_finite(name, one)
    else:
        check_range(name, value)
