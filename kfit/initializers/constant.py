"""The same value for every start."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import torch
from torch import Tensor

from kfit.core import Initializer, Observation, Variable, Variables
from kfit.core.check import check_dict, check_range


class Constant(Initializer):
    """Starts each variable at one value.

    Args:
        values: by variable; a number fills the variable's whole shape, a list must match it.
    """

    def __init__(self, values: dict[str, float | list[float]]) -> None:
        check_dict("Constant: values", values, _check_finite)
        self.values, self.on = values, tuple(values)

    def __call__(
        self,
        variables: Mapping[str, Variable],
        observation: Observation,
        num_starts: int,
        rngs: Sequence[torch.Generator],
    ) -> Variables:
        rows = observation.num_problems * num_starts
        started = {}
        for name, value in self.values.items():
            tensor, shape = torch.as_tensor(value, dtype=observation.image.dtype), variables[name].shape
            if tensor.dim() and tensor.shape != shape:
                raise ValueError(f"Constant: {name} must be a number or of shape {shape}, got {tuple(tensor.shape)}")
            started[name] = tensor.expand(rows, *shape).clone()
        return started


def _check_finite(name: str, value: Any) -> None:
    """Refuse what is no finite number, nor a list or tensor of such."""
    if isinstance(value, Tensor | list | tuple):
        for one in value.flatten().tolist() if isinstance(value, Tensor) else value:
            _check_finite(name, one)
    else:
        check_range(name, value)
