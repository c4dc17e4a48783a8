"""The focal length of a known camera."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch

from kfit.core import Initializer, Observation, Variable, Variables


class FromCamera(Initializer):
    """Set ``focal``, the focal length over the picture's width, from the observation's intrinsics.

    φ = (f_x + f_y) / 2 / W. A generator with a ``focal`` in a `kfit.generators.SimilarityWarp` then draws with the
    photo's own perspective.

    Raises:
        ValueError: when called, if the observation has no intrinsics.

    Example:
        >>> import torch
        >>> from kfit.core import Observation, Positive, Variable
        >>> from kfit.geometry import intrinsics_from_fov
        >>> from kfit.initializers import FromCamera
        >>> observation = Observation(torch.ones(1, 3, 64, 64), intrinsics=intrinsics_from_fov(64, 64, 60)[None])
        >>> FromCamera()({"focal": Variable((), Positive())}, observation, 2, [])["focal"]
        tensor([0.8660, 0.8660])
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
