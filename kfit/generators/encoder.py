"""The encoder beside a generator: from a picture to a Gaussian over codes."""

from __future__ import annotations

from collections.abc import Sequence

from torch import Tensor, nn

from kfit.core import Encoder


class ConvEncoder(Encoder):
    """Says which codes could have drawn a picture, by convolutions.

    Stride-2 convolutions, normalised from the second on, then two linear layers. The released encoder is that of
    ``channels=(64, 128, 256, 512), instance_norm=True``.

    Args:
        code_dim: D.
        channels: of each convolution.
        hidden_dim: between the linear layers.
        image_size: side of the pictures it takes.
        instance_norm: normalise each channel alone, as the released encoder does, which hides an object's overall
            colour from the layers behind; groups of channels are normalised together unless asked for.
    """

    def __init__(
        self,
        code_dim: int = 16,
        channels: Sequence[int] = (32, 64, 128, 256),
        hidden_dim: int = 128,
        image_size: int = 64,
        instance_norm: bool = False,
    ) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        for index, (a, b) in enumerate(zip((3, *channels[:-1]), channels, strict=True)):
            layers += [nn.Conv2d(a, b, 3, 2, 1), nn.LeakyReLU(0.2)]
            if index:
                layers.append(nn.InstanceNorm2d(b) if instance_norm else nn.GroupNorm(8, b))
        self.look = nn.Sequential(*layers)
        side = image_size // 2 ** len(channels)
        self.say = nn.Sequential(
            nn.Linear(channels[-1] * side**2, hidden_dim), nn.LeakyReLU(0.2), nn.Linear(hidden_dim, 2 * code_dim)
        )

    def forward(self, image: Tensor) -> tuple[Tensor, Tensor]:
        """Mean and log-variance (N, D) of the code, from RGB (N, 3, S, S) in [0, 1] on white."""
        mean, log_variance = self.say(self.look(2 * image - 1).flatten(1)).float().chunk(2, 1)
        return mean, log_variance
