"""Activations of any torch network as a feature network."""

from __future__ import annotations

from collections.abc import Sequence
from contextvars import ContextVar
from functools import partial
from typing import Any

from torch import Tensor, nn

from kfit.core import frozen
from kfit.core.arguments import check_arguments
from kfit.core.check import check_names
from kfit.features.network import FeatureNetwork

# Activations of the current call, filled by hooks. Threads share networks, and each thread has its own context.
_FOUND: ContextVar[dict[str, Any] | None] = ContextVar("found", default=None)


class Activations(FeatureNetwork):
    """Outputs of named modules of any torch network, such as DINO's blocks.

    A frozen copy of the network in evaluation mode is used; the original is not changed. Of a module that returns a
    tuple the first tensor is used, and of one that runs several times for a picture the last output.

    Tokens (N, T, D) of a transformer become (N, D, h, w) if ``num_prefix_tokens`` is set: that many tokens are dropped
    at the front, and the others fill a grid row by row, with the picture's aspect ratio. For a network that needs
    pictures of another size, put an ``nn.Upsample`` before it in an ``nn.Sequential``; its modules' names then start
    with "1.".

    Shape: pictures (N, 3, H, W) in [0, 1]; features (N, C, h, w).

    Args:
        network: takes normalised pictures (N, 3, H, W).
        layers: names of its modules as in ``network.named_modules()``, such as "layer2.0.conv1".
        num_prefix_tokens: number of tokens at the front that are not patches (class and register tokens); None if the
            layers return pictures.
        mean, std: normalisation of pictures, one number for each channel; by default ImageNet's.

    Raises:
        ValueError: if a module does not exist or did not run, or an output has another shape.

    Example:
        >>> import torch
        >>> from kfit.features import Activations
        >>> network = torch.nn.Sequential(torch.nn.Conv2d(3, 8, 3, stride=2, padding=1), torch.nn.ReLU())
        >>> features = Activations(network, ["1"])(torch.rand(2, 3, 64, 64))
        >>> features["1"].shape
        torch.Size([2, 8, 32, 32])
    """

    def __init__(
        self,
        network: nn.Module,
        layers: Sequence[str],
        num_prefix_tokens: int | None = None,
        mean: tuple[float, float, float] = (0.485, 0.456, 0.406),
        std: tuple[float, float, float] = (0.229, 0.224, 0.225),
    ) -> None:
        super().__init__(mean, std)
        check_arguments(Activations, locals(), num_prefix_tokens=(0,))
        self.network, self.layers, self.num_prefix_tokens = frozen(network), tuple(layers), num_prefix_tokens
        modules = dict(self.network.named_modules())
        check_names("layers", layers, modules)
        for name in self.layers:
            modules[name].register_forward_hook(partial(_remember, name))
        self.freeze()

    def forward(self, image: Tensor) -> dict[str, Tensor]:
        found: dict[str, Any] = {}
        token = _FOUND.set(found)
        try:
            self.network(self.normalized(image))
        finally:
            _FOUND.reset(token)
        missing = [name for name in self.layers if name not in found]
        if missing:
            raise ValueError(f"layers: {', '.join(missing)} did not run in the network's forward pass")
        return {name: self._picture(name, found[name], image) for name in self.layers}

    def _picture(self, name: str, output: Any, image: Tensor) -> Tensor:
        came = tuple(output.shape) if isinstance(output, Tensor) else type(output).__name__
        if isinstance(output, Tensor) and output.dim() == 4:
            return output
        if not isinstance(output, Tensor) or output.dim() != 3 or self.num_prefix_tokens is None:
            raise ValueError(
                f"layers: {name} must give (N, C, h, w), or tokens (N, T, D) where num_prefix_tokens is set, got {came}"
            )
        height, width = image.shape[-2:]
        patches = output[:, self.num_prefix_tokens :]
        rows = round((patches.shape[1] * height / width) ** 0.5)
        columns = patches.shape[1] // max(rows, 1)
        if rows * columns == 0 or rows * columns != patches.shape[1]:
            raise ValueError(
                f"num_prefix_tokens: after {self.num_prefix_tokens} tokens, {name} leaves {patches.shape[1]} for a "
                f"picture of {height}×{width}, which fill no grid of its aspect"
            )
        picture: Tensor = patches.transpose(1, 2).unflatten(2, (rows, columns))
        return picture


def _remember(name: str, module: nn.Module, inputs: Any, output: Any) -> None:
    found = _FOUND.get()
    if found is not None:
        first = output[0] if isinstance(output, (tuple, list)) else output
        # a copy, because the next module may write into its input
        found[name] = first.clone() if isinstance(first, Tensor) else first
