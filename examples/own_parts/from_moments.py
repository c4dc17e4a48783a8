"""An initializer of one's own: starts where the picture is bright."""

from collections.abc import Mapping, Sequence

import torch

from kfit.core import Initializer, Observation, Variable, Variables


class FromMoments(Initializer):
    """Sets ``middle`` and ``radii`` to the mean and twice the spread of the bright pixels, scattered at random.

    Args:
        scatter: standard deviation of the starts around that, in half-widths.
    """

    on = ("middle", "radii")

    def __init__(self, scatter: float = 0.1) -> None:
        self.scatter = scatter

    def __call__(
        self,
        variables: Mapping[str, Variable],
        observation: Observation,
        num_starts: int,
        rngs: Sequence[torch.Generator],
    ) -> Variables:
        grey = observation.image.mean(1)
        share = (grey > grey.mean((1, 2), keepdim=True)).to(grey)
        share = share / share.sum((1, 2), keepdim=True)
        x, y = torch.linspace(-1, 1, grey.shape[2]), -torch.linspace(-1, 1, grey.shape[1])[:, None]
        middle = torch.stack([(share * x).sum((1, 2)), (share * y).sum((1, 2))], 1)
        away = (x - middle[:, 0, None, None]) ** 2 + (y - middle[:, 1, None, None]) ** 2
        radius = (2 * (share * away).sum((1, 2))).sqrt()
        noise = torch.cat([torch.randn(num_starts, 2, generator=rng) for rng in rngs])
        return {
            "middle": middle.repeat_interleave(num_starts, 0) + self.scatter * noise,
            "radii": radius[:, None].expand(-1, 2).repeat_interleave(num_starts, 0).clone(),
        }
