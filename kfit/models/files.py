"""Model files: safetensors beside a JSON card, read as data and never as code."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError
from safetensors.torch import load, save
from torch import nn

from kfit.core.whole_files import write_whole
from kfit.models.card import Card

NETWORKS = ("generator", "encoder", "extents")
OPTIONAL = ("pose_head",)
# Where kfit's own networks are; loading torch before is in vain.
HOMES = ("kfit.generators", "kfit.baselines")


def write_model(path: Path, networks: dict[str, nn.Module], card: Card) -> None:
    """Write ``path`` (.safetensors, half precision) and its card beside it, both or neither."""
    numbers = {
        f"{name}.{key}": (tensor.half() if tensor.is_floating_point() else tensor).contiguous()
        for name, network in networks.items()
        for key, tensor in network.state_dict().items()
    }
    card_name = path.with_suffix(".json").name
    write_whole(path.parent, {path.name: lambda place: place.write_bytes(save(numbers)), card_name: card.write})


def read_model(path: Path) -> tuple[dict[str, nn.Module], Card]:
    """Read a model's networks, in evaluation mode, and its card.

    Raises:
        FileNotFoundError: if a file is missing.
        ValueError: if one is damaged, or the weights do not fit the networks that the card names.
    """
    if not path.is_file():
        raise FileNotFoundError(f"no model at {path}; train one with `lightning fit` and pack it with `kfit pack`")
    card = Card.read(path.with_suffix(".json"))
    try:
        # `load_file` of safetensors 0.8.0 leaks 7 kB of Python's numbers each time that it reads such a file.
        numbers = load(path.read_bytes())
    except (SafetensorError, OSError, KeyError, ValueError) as error:  # KeyError for types that PyTorch has not
        raise ValueError(f"{path} is damaged or no safetensors file: {error}") from None
    networks = {}
    for name in _names(card.networks):
        network = _build(card.networks.get(name), name, path)
        own = {key.removeprefix(f"{name}."): t for key, t in numbers.items() if key.startswith(f"{name}.")}
        try:
            network.load_state_dict(own)  # halves become floats again
        except RuntimeError:
            raise ValueError(
                f"{path} does not fit its card: the weights are not those of the {name} named there"
            ) from None
        networks[name] = network.eval()
    return networks, card


def read_checkpoint(path: Path, names: Sequence[str] = NETWORKS) -> tuple[dict[str, nn.Module], dict[str, Any]]:
    """Read networks and hyperparameters that a training of kfit's saved through ``lightning fit``.

    Where the training averaged weights, they are the averages.

    Args:
        path: of the checkpoint.
        names: of the networks: `kfit.training.ConditionalVAE`'s, or ``("pose_head",)`` of
            `kfit.training.PoseTraining`.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: if it is no such checkpoint.
    """
    if not path.is_file():
        raise FileNotFoundError(f"no checkpoint at {path}")
    try:
        saved = torch.load(path, map_location="cpu", weights_only=True)
        said, numbers = saved["hyper_parameters"], saved["state_dict"]
        saved["datamodule_hyper_parameters"]["category"]
    except Exception as error:
        raise ValueError(f"{path} is no checkpoint by `lightning fit`: {str(error).splitlines()[0]}") from None
    networks = {}
    for name in names:
        network = _build(said.get(name), name, path)
        network.load_state_dict({k.removeprefix(f"{name}."): t for k, t in numbers.items() if k.startswith(f"{name}.")})
        networks[name] = network.eval()
    return networks, saved


def _names(said: dict[str, Any]) -> list[str]:
    """The networks that a file must hold, and of the others those that it names."""
    return [*NETWORKS, *(name for name in OPTIONAL if said.get(name) is not None)]


def _build(said: Any, name: str, path: Path) -> nn.Module:
    """The network that a file names. Only kfit's classes and those of modules that the caller has imported already are
    built, so that a file cannot have code imported or a function called."""
    if not (isinstance(said, dict) and isinstance(said.get("class_path"), str)):
        raise ValueError(f"{path} names no class for the {name}")
    module, _, kind = said["class_path"].rpartition(".")
    if (home := ".".join(module.split(".")[:2])) in HOMES:
        importlib.import_module(home)
    found = getattr(sys.modules.get(module), kind, None)
    if not (isinstance(found, type) and issubclass(found, nn.Module)):
        raise ValueError(
            f"{path} names {said['class_path']} as {name}: no network of kfit, nor of a module imported before"
        )
    try:
        return found(**said.get("init_args", {}))
    except (TypeError, ValueError, RuntimeError) as error:
        raise ValueError(f"{path}: {said['class_path']} cannot be built as its card says: {error}") from None
