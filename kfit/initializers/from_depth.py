"""The object's distance from a depth map."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch
from torch import Tensor, nn

from kfit.core import Generator, Initializer, Observation, Variable, Variables, frozen

# Number of quantiles of the pixels' distances among which the distance is chosen, and the relative difference of pixels
# that agree with it.
NUM_CHOICES = 31
AGREEMENT = 0.01


class FromDepth(Initializer):
    """Set `kfit.generators.MetricDepth`'s ``distance`` such that the initial drawing lies on the observed surface.

    The other initializers set all other variables. Each start is then drawn once, without gradients. Drawn depth is
    proportional to the distance, so each drawn pixel whose depth is known gives an estimate of the distance,
    t_p = observed depth / drawn depth at distance 1. Of 31 evenly spaced quantiles of these, the one with which most
    pixels agree is taken, the maximum of Σ_p exp(−((t_p / t − 1) / 0.01)² / 2), and the nearer one of equals: up to
    half of the pixels may lie on something behind the object. If no drawn pixel is known, all known pixels count. A
    picture without any known depth has no distance: its starts are NaN.

    Args:
        generator: draws depth and has a ``distance``.
        initializers: set its other variables.

    Raises:
        ValueError: when called, if the observation has no depth, or no picture has a pixel of known depth.

    Example:
        >>> import torch
        >>> from kfit.core import Observation
        >>> from kfit.generators import MetricDepth, SimilarityWarp, VAE2D, fixed_camera
        >>> from kfit.initializers import Constant, FromDepth
        >>> generator = MetricDepth(SimilarityWarp(VAE2D(decoder_dims=(8, 8), depth=True)), unit_fraction=1.0)
        >>> others = {name: 0.0 for name in ("code", "azimuth", "elevation", "roll", "shift")}
        >>> start = FromDepth(generator, [Constant({**others, "scale": 1.0, "focal": 4.0})])
        >>> observation = Observation(torch.ones(1, 3, 8, 8), depth=torch.full((1, 1, 8, 8), 0.7))
        >>> start(generator.variables, observation, 1, [torch.Generator()])["distance"].shape
        torch.Size([1])
    """

    def __init__(self, generator: Generator, initializers: Sequence[Initializer]) -> None:
        self.generator, self.initializers = frozen(generator), list(initializers)
        self.on = (*(name for initializer in initializers for name in initializer.on), "distance")
        # A pipeline registers the networks it finds here, and moves them with it.
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
    """Return the distance (N,) with which most of (N, M) agree; NaN is ignored."""
    even = (torch.arange(NUM_CHOICES, device=each.device) + 0.5) / NUM_CHOICES
    choices = torch.nanquantile(each, even.to(each), dim=1)
    off = (each / choices[..., None] - 1) / AGREEMENT
    agreeing = torch.exp(-off.square() / 2).nansum(2)
    return choices.gather(0, agreeing.argmax(0)[None])[0]
