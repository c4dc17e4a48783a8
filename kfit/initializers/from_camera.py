"""How long the lens of the photo is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch

from kfit.core import Initializer, Observation, Variable, Variables


class FromCamera(Initializer):
    """Sets ``focal``, the focal length over the picture's width, by the observation's intrinsics.

    φ = (f_x + f_y) / 2 / W. With it, what `kfit.generators.SimilarityWarp` draws of a generator that has a ``focal``
    has the photo's own perspective.

    Raises:
        ValueError: when it is called, for an observation without intrinsics.
    """

    on = ("focal",)

    def __call__(
        self,
        variables: Mapping[str, Variable],
        observation: Observation,
        num_starts: int,
        rngs: Sequence[torch.Generator],
    ) -> Variables:
        intrinsics = observation.field("intrinsics")
        focal = (intrinsics[:, 0, 0] + intrinsics[:, 1, 1]) / 2 / observation.image.shape[-1]
        return {"focal": focal.to(observation.image).repeat_interleave(num_starts)}
