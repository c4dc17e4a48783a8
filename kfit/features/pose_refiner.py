"""A network that sees a photo and a drawing and predicts how the drawing's pose must change."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file
from torch import Tensor, nn
from torch.nn import functional as F

from kfit.core.arguments import check_arguments
from kfit.core.check import check_count
from kfit.features.convolutions import Residual, convolution
from kfit.geometry.refiner_network import PoseUpdate, RefinerNetwork
from kfit.runtime.torch_file import read_torch

# Outputs of 1 stand for a rotation of 0.3 radians, a shift of 0.1 half-widths and a log scale of 0.1.
UNITS = (0.3, 0.3, 0.3, 0.1, 0.1, 0.1)
# Limits of the logarithms of expected errors.
LEAST_LOG_ERROR, MOST_LOG_ERROR = -6.0, 1.0


class PoseRefiner(RefinerNetwork):
    """Predicts from a photo and a drawing of any category how the pose must change, and whether it is right.

    Both pictures and masks are concatenated, as in DeepIM (Li et al. 2018) and MegaPose (Labbé et al. 2022), and go
    through a stride-2 convolution for each level, each followed by a residual one, and two linear layers.
    `kfit.training.RefinerTraining` trains it.

    Shape: photos and drawings (N, 4, S, S), RGB in [0, 1] on white and mask; resized to ``image_size`` where S differs.

    Args:
        weights: a checkpoint (.ckpt) of `kfit.training.RefinerTraining`, or a .safetensors file; None for random ones,
            to be trained.
        channels: numbers of channels of the levels, each half as wide and high as the one before.
        hidden_dim: units between the linear layers.
        image_size: side in pixels of the pictures that are compared.

    Raises:
        FileNotFoundError: for a file that is missing.
        ValueError: for a setting out of range, or weights of other settings.

    Example:
        >>> refiner = PoseRefiner(None).eval()  # untrained, it leaves poses as they are
        >>> refiner(torch.rand(2, 4, 64, 64), torch.rand(2, 4, 64, 64)).rotation.norm()
        tensor(0., grad_fn=<LinalgVectorNormBackward0>)
    """

    units: Tensor

    def __init__(
        self,
        weights: str | None,
        channels: Sequence[int] = (32, 64, 128, 192),
        hidden_dim: int = 256,
        image_size: int = 64,
    ) -> None:
        super().__init__()
        check_arguments(PoseRefiner, locals(), channels=(4,))
        check_count("PoseRefiner: image_size", image_size, 2 ** len(channels))
        self.image_size = image_size
        self.trunk = nn.Sequential()
        for a, b in pairwise((8, *channels)):
            self.trunk.extend([convolution(a, b, 2), Residual(b)])
        self.hidden = nn.Linear(channels[-1] * (image_size // 2 ** len(channels)) ** 2, hidden_dim)
        self.out = nn.Linear(hidden_dim, 11)
        nn.init.zeros_(self.out.weight)
        nn.init.zeros_(self.out.bias)
        self.register_buffer("units", torch.tensor(UNITS), persistent=False)
        if weights is not None:
            try:
                self.load_state_dict(_state(weights))
            except RuntimeError:
                raise ValueError(
                    f"PoseRefiner: the weights {weights!r} are of another network than these settings"
                ) from None
            self.eval()

    def forward(self, observed: Tensor, drawn: Tensor) -> PoseUpdate:
        pair = torch.cat([observed, drawn], 1)
        if pair.shape[-1] != self.image_size:
            pair = F.interpolate(pair, (self.image_size,) * 2, mode="bilinear", antialias=True, align_corners=False)
        found = self.out(F.leaky_relu(self.hidden(self.trunk(2 * pair - 1).flatten(1)), 0.2))
        # Half precision, under autocast, is too coarse for what follows.
        found = found.to(torch.promote_types(found.dtype, torch.float32))
        step, log_error = found[:, :6] * self.units, found[:, 6:10] + self.units[[0, 0, 3, 5]].log()
        log_error = log_error.clamp(LEAST_LOG_ERROR, MOST_LOG_ERROR)
        return PoseUpdate(step[:, :3], step[:, 3:5], step[:, 5], log_error, found[:, 10])


def _state(weights: str) -> dict[str, Tensor]:
    path = Path(weights)
    if not path.is_file():
        raise FileNotFoundError(f"PoseRefiner: no weights at {path}")
    try:
        if path.suffix == ".safetensors":
            return load_file(path)
        numbers = read_torch(path)["state_dict"]
        return {key.removeprefix("refiner."): value for key, value in numbers.items()}
    except (SafetensorError, ValueError, TypeError, KeyError, AttributeError) as error:
        raise ValueError(f"PoseRefiner: {path} holds no weights of a refiner: {error}") from None
