"""Codes drawn from an encoder's distribution for the picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch
from torch import Tensor

from kfit.core import Encoder, Initializer, Observation, Variable, Variables, frozen
from kfit.core.arguments import check_arguments


class EncoderPosterior(Initializer):
    """Draw the code from the Gaussian that an encoder predicts for the observed picture (paper, section 3.3).

    z = μ(I) + sigma · σ(I) · ε, ε ~ N(0, 1); the first start of each problem takes the mean.

    Args:
        encoder: image (B, C, H, W) → mean and log-variance, (B, D) each.
        on: name of the variable.
        sigma: factor of the standard deviation; 0 starts all rows at the mean.

    Raises:
        ValueError: if ``sigma`` is below 0.

    Example:
        >>> import torch
        >>> from kfit.core import Observation, Variable
        >>> from kfit.generators import ConvEncoder
        >>> from kfit.initializers import EncoderPosterior
        >>> start = EncoderPosterior(ConvEncoder(code_dim=8))
        >>> observation, rng = Observation(torch.rand(1, 3, 64, 64)), torch.Generator().manual_seed(0)
        >>> start({"code": Variable((8,))}, observation, 4, [rng])["code"].shape
        torch.Size([4, 8])
    """

    def __init__(self, encoder: Encoder, on: str = "code", sigma: float = 1.0) -> None:
        check_arguments(EncoderPosterior, locals(), sigma=(0,))
        self.encoder, self.on, self.sigma = frozen(encoder), (on,), sigma

    def __call__(
        self,
        variables: Mapping[str, Variable],
        observation: Observation,
        num_starts: int,
        rngs: Sequence[torch.Generator],
    ) -> Variables:
        with torch.no_grad():
            mean, log_variance = self.encoder(observation.image)
        noise = torch.stack([self._noise(num_starts, mean.shape[1], rng) for rng in rngs]).to(mean)
        codes = mean[:, None] + self.sigma * (0.5 * log_variance[:, None]).exp() * noise
        return {self.on[0]: codes.flatten(0, 1)}

    @staticmethod
    def _noise(num_starts: int, code_dim: int, rng: torch.Generator) -> Tensor:
        noise = torch.randn(num_starts, code_dim, generator=rng, dtype=torch.float32)
        noise[0] = 0
        return noise
