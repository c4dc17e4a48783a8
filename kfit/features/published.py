"""The weights that torchvision publishes, without torchvision."""

from __future__ import annotations

import logging
import pickle
from collections.abc import Mapping
from pathlib import Path

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file
from torch import Tensor, nn

from kfit.core.check import check_text
from kfit.runtime.torch_file import read_torch

_log = logging.getLogger(__name__)


def fill_published(network: nn.Module, url: str, megabytes: int, weights: str | None = None) -> None:
    """Load torchvision's published weights into a network.

    Args:
        network: its class has the name of torchvision's, and its parameters torchvision's names.
        url: url of the published file, which is looked up in torch.hub's cache first.
        megabytes: size of that file, for the message about the download.
        weights: path of a .pth or .safetensors file to load instead.

    Raises:
        ValueError: if the file is truncated or holds another network.
        FileNotFoundError: if there is no file at ``weights``.
        RuntimeError: if the published file cannot be downloaded.
    """
    if weights is not None:
        check_text("weights", weights)
    name = type(network).__name__
    state = _read(weights) if weights is not None else _fetch(name, url, megabytes)
    for parameter_name, parameter in network.named_parameters():
        tensor = state.get(parameter_name)
        if not isinstance(tensor, Tensor) or tensor.shape != parameter.shape:
            came = f"of shape {tuple(tensor.shape)}" if isinstance(tensor, Tensor) else "missing"
            raise ValueError(
                f"weights: {weights or url} is not torchvision's {name}: {parameter_name} must have shape "
                f"{tuple(parameter.shape)} and is {came}"
            )
        parameter.data.copy_(tensor)


def _fetch(name: str, url: str, megabytes: int) -> Mapping[str, Tensor]:
    cache, file = Path(torch.hub.get_dir()) / "checkpoints", url.rsplit("/", 1)[1]
    if not (cache / file).exists():
        _log.warning("fetching %s's weights (%d MB) from %s to %s", name, megabytes, url, cache)
    try:
        state: Mapping[str, Tensor] = torch.hub.load_state_dict_from_url(
            url, map_location="cpu", check_hash=True, weights_only=True
        )
    except (OSError, RuntimeError, EOFError, pickle.UnpicklingError) as error:
        raise RuntimeError(
            f"{name}'s weights could not be had from {url} ({error}); fetch the file where there is a network "
            f"and pass its path, {name}(weights='{file}'), or put it into {cache}"
        ) from error
    return state


def _read(path: str) -> Mapping[str, Tensor]:
    if not Path(path).is_file():
        raise FileNotFoundError(f"weights: there is no file {path}")
    try:
        state = load_file(path) if str(path).endswith(".safetensors") else read_torch(path)
    except (SafetensorError, ValueError, OSError) as error:
        raise ValueError(
            f"weights: {path} cannot be read; it must be a complete .pth or .safetensors file of tensors by name"
        ) from error
    return state if isinstance(state, Mapping) else {}
