"""Where a depth camera saw the object."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch
from torch import Tensor, nn

from kfit.core import Generator, Initializer, Observation, Variable, Variables, frozen

# Quantiles of the pixels' distances among which the distance is chosen, and the share of it by which pixels that agree
# with it may differ.
NUM_CHOICES = 31
AGREEMENT = 0.01


class FromDepth(Initializer):
    """Sets `kfit.generators.MetricDepth`'s ``distance`` so that the drawing at the start lies on the observed surface.

    Other initializers set all other variables; each start is drawn once, without a gradient. Drawn depth is
    proportional to the distance, so that every pixel of the drawing whose depth is known gives a distance of its own,
    t_p = observed depth / drawn depth at distance 1. Of 31 even quantiles of these that one is taken with which most
    pixels agree, Σ_p exp(−((t_p / t − 1) / 0.01)² / 2), the nearer of two alike: half of the pixels may be on something
    behind the object. Where no such pixel is drawn, all that are known count. A picture in which no depth is known has
    no distance: its starts are NaN.

    Args:
        generator: draws depth and has a ``distance``.
        initializers: set its other variables.

    Raises:
        ValueError: when it is called, for an observation without depth or in whose pictures no depth is known.
    """

    def __init__(self, generator: Generator, initializers: Sequence[Initializer]) -> None:
        self.generator, self.initializers = frozen(generator), list(initializers)
        self.on = (*(name for initializer in initializers for name in initializer.on), "distance")
        # So that a pipeline finds them, and moves them with it.
        held = [value for initializer in initializers for value in vars(initializer).values()]
        self.networks = nn.ModuleList(value for value in held if isinstance(value, nn.Module))

    def __call__(
        self,
        variables: Mapping[str, Variable],
        observation: Observation,
        num_starts: int,
        rngs: Sequence[torch.Generator],
    ) -> Variables:
        depth = observation.field("depth")
        if not bool(depth.isfinite().any()):
            raise ValueError("FromDepth: depth must be known somewhere, got pictures in which it is nowhere")
        found: Variables = {}
        for initializer in self.initializers:
            found |= initializer(variables, observation, num_starts, rngs)
        found = {name: value.to(observation.image) for name, value in found.items()}
        with torch.no_grad():
            drawn = self.generator(**found, distance=depth.new_ones(len(depth) * num_starts))
        rows = depth.repeat_interleave(num_starts, 0)
        known = rows.isfinite()
        drawn_there = known & (drawn.field("mask") > 0.5)
        counted = torch.where(drawn_there.flatten(1).any(1)[:, None, None, None], drawn_there, known)
        each = (rows / drawn.field("depth")).where(counted, torch.nan).flatten(1)
        return found | {"distance": _agreed(each)}


def _agreed(each: Tensor) -> Tensor:
    """Of distances (N, M), NaN where there is none, the one (N,) with which most agree."""
    even = (torch.arange(NUM_CHOICES, device=each.device) + 0.5) / NUM_CHOICES
    choices = torch.nanquantile(each, even.to(each), dim=1)
    off = (each / choices[..., None] - 1) / AGREEMENT
    agreeing = torch.exp(-off.square() / 2).nansum(2)
    return choices.gather(0, agreeing.argmax(0)[None])[0]
