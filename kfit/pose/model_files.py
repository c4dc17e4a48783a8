"""Model files: safetensors with a card in the metadata, read as data and never as code."""

from __future__ import annotations

import importlib
import io
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import torch
from safetensors import SafetensorError
from safetensors.torch import load, save
from torch import Tensor, nn

from kfit.core import Encoder, Generator
from kfit.generators import ExtentsHead
from kfit.geometry import PoseNetwork
from kfit.pose.card import LARGEST, NETWORKS, OPTIONAL, Card
from kfit.pose.network_limits import LimitedSize, check_drawing, check_network_sizes
from kfit.runtime.atomic_write import atomic_write
from kfit.runtime.class_paths import current_paths
from kfit.runtime.torch_file import LARGEST_WEIGHTS, read_torch

# Base class of each network, kfit's or the user's own.
ROLES: dict[str, type[nn.Module]] = {
    "generator": Generator,
    "encoder": Encoder,
    "extents": ExtentsHead,
    "pose_head": PoseNetwork,
    "regressor": nn.Module,
}
# kfit's classes that a file may name: they are self-contained, and open no other file.
OWN = {
    "kfit.generators": [
        "RadianceField",
        "VAE2D",
        "VAE3D",
        "ConvEncoder",
        "FeatureEncoder",
        "ExtentsHead",
        "PoseHead",
        "RotationHead",
    ],
    "kfit.baselines": ["CoordinateRegressor", "OrientationRegressor"],
}
# Numbers that networks may have beyond the file's: constants that are not stored, and a margin.
ROOM = 16_000_000
# Key of the card in the metadata. Files of version 0.1 lack it; their card is NAME.json in the same folder.
METADATA = "kfit_card"
# Bytes; the same limit as in safetensors.
LARGEST_HEADER = 100_000_000


def write_model(path: Path, networks: dict[str, nn.Module], card: Card) -> None:
    """Write networks, in half precision, and their card atomically as one file.

    Example:
        >>> from pathlib import Path
        >>> import kfit
        >>> from kfit.models import write_model
        >>> model = kfit.load("can")
        >>> write_model(Path("copy.safetensors"), model.networks, model.card)
        >>> kfit.load("copy.safetensors").card.category
        'can'
    """
    content = model_content(networks, card)
    atomic_write(path.parent, {path.name: lambda place: place.write_bytes(content)})


def model_content(networks: dict[str, nn.Module], card: Card) -> bytes:
    """Return the content that `write_model` writes."""
    numbers = {
        f"{name}.{key}": (tensor.half() if tensor.is_floating_point() else tensor).contiguous()
        for name, network in networks.items()
        for key, tensor in network.state_dict().items()
    }
    return save(numbers, {METADATA: card.to_json()})


def read_model(path: Path) -> tuple[dict[str, nn.Module], Card]:
    """Read a model's networks, in evaluation mode, and its card.

    Raises:
        FileNotFoundError: if a file is missing.
        ValueError: if one is damaged, or the weights do not match the networks of the card.

    Example:
        >>> from kfit.models import read_model
        >>> from kfit.models.load import BUNDLED
        >>> networks, card = read_model(BUNDLED / "can.safetensors")
        >>> sorted(networks)
        ['encoder', 'extents', 'generator', 'pose_head']
    """
    _check_file(path)
    content = (
        path.read_bytes()
    )  # read once, so that weights and card belong together even if the file is replaced meanwhile
    try:
        # `load_file` of safetensors 0.8.0 leaks 7 kB of Python's numbers each time that it reads such a file.
        numbers = load(content)
    except (SafetensorError, OSError, KeyError, ValueError) as error:  # KeyError for types that PyTorch has not
        raise ValueError(f"{path} is damaged or no safetensors file: {error}") from None
    card = _card(io.BytesIO(content), path)
    names = [*NETWORKS, *(name for name in OPTIONAL if name in card.networks)]
    networks = {name: _filled(card.networks.get(name), name, numbers, path) for name in names}
    return networks, card


def read_card(path: str | Path) -> Card:
    """Read a model's card without its weights.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: if it holds no valid card.

    Example:
        >>> from kfit.models import read_card
        >>> from kfit.models.load import BUNDLED
        >>> read_card(BUNDLED / "mug.safetensors").symmetry
        'none'
    """
    path = Path(path)
    _check_file(path)
    with path.open("rb") as file:
        return _card(file, path)


def _check_file(path: Path) -> None:
    if not path.is_file():
        raise FileNotFoundError(f"no model at {path}; train one with `lightning fit` and pack it with `kfit pack`")
    if (size := path.stat().st_size) > LARGEST_WEIGHTS:
        raise ValueError(f"{path} has {size:,} bytes, more than the {LARGEST_WEIGHTS >> 30} GB that a model may have")


def _card(file: BinaryIO, path: Path) -> Card:
    """Return the card in a safetensors file's metadata or, for a file without one, of the JSON file next to it."""
    length = int.from_bytes(file.read(8), "little")
    try:
        if length > LARGEST_HEADER:
            raise ValueError(f"its header has {length:,} bytes, more than {LARGEST_HEADER:,}")
        metadata = json.loads(file.read(length)).get("__metadata__", {})
    except (ValueError, RecursionError, AttributeError) as error:
        raise ValueError(f"{path} is damaged or no safetensors file: {error}") from None
    if isinstance(metadata, dict) and METADATA in metadata:
        return Card.of_json(str(metadata[METADATA]), path)
    old = path.with_suffix(".json")
    if not old.is_file():
        raise ValueError(f"{path} holds no model card, and there is none at {old}, where version 0.1 kept it")
    with old.open("rb") as text:
        content = text.read(LARGEST + 1)
    try:
        return Card.of_json(content.decode(), old)
    except UnicodeDecodeError as error:
        raise ValueError(f"{old} holds no model card: {error}") from None


def read_checkpoint(path: Path, names: Sequence[str] = NETWORKS) -> tuple[dict[str, nn.Module], dict[str, Any]]:
    """Read networks and hyperparameters from a checkpoint of ``lightning fit``.

    If the training averaged weights, the averages are read.

    Args:
        path: path of the checkpoint.
        names: names of the networks: `kfit.training.ConditionalVAE`'s, or ``("pose_head",)`` of
            `kfit.training.PoseTraining`.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: if it is not such a checkpoint.

    Example:
        >>> from pathlib import Path
        >>> from kfit.models import read_checkpoint
        >>> networks, saved = read_checkpoint(Path("lightning_logs/version_0/checkpoints/last.ckpt"))
        Traceback (most recent call last):
        FileNotFoundError: no checkpoint at lightning_logs/version_0/checkpoints/last.ckpt
    """
    if not path.is_file():
        raise FileNotFoundError(f"no checkpoint at {path}")
    try:
        saved = read_torch(path)
        if isinstance(saved, dict) and "netG" in saved:
            raise ValueError("it is a released one of neural_object_fitting, which `kfit pack --category` takes")
        settings, numbers = dict(saved["hyper_parameters"]), dict(saved["state_dict"])
        saved["datamodule_hyper_parameters"]["category"]
    except (ValueError, TypeError, KeyError, IndexError) as error:
        raise ValueError(f"{path} is no checkpoint by `lightning fit`: {error}") from None
    return {name: _filled(settings.get(name), name, numbers, path) for name in names}, saved


def _filled(settings: Any, name: str, numbers: Mapping[Any, Any], path: Path) -> nn.Module:
    """Build the network that a file names, with the file's numbers, in evaluation mode.

    Only the allowed classes of kfit, and the user's own in modules that are imported already, are built, so that a file
    cannot import code or call functions. Networks larger than the file's numbers are refused.
    """
    if not (isinstance(settings, dict) and isinstance(settings.get("class_path"), str)):
        held = {str(key).partition(".")[0] for key in numbers} & ROLES.keys()
        if held and name not in held:
            raise ValueError(
                f"{path} must hold the {name}, but holds the {', '.join(sorted(held))} of another training"
            )
        raise ValueError(
            f"{path} names no class for the {name}: networks built in Python are not written by name, so train by a "
            "recipe or write the model with kfit.models.write_model"
        )
    named = repr(settings["class_path"][:100])
    own = {key.removeprefix(f"{name}."): t for key, t in numbers.items() if str(key).startswith(f"{name}.")}
    settings = current_paths(settings)
    kind = _kind(settings["class_path"])
    if not (isinstance(kind, type) and issubclass(kind, ROLES[name])):
        raise ValueError(
            f"{path} names {named} as {name}: no network of kfit, nor of a module imported before, that could be one"
        )
    if not all(isinstance(tensor, Tensor) for tensor in own.values()):
        raise ValueError(f"{path} holds something else than tensors for the {name}")
    try:
        # The constructor's random numbers are replaced by the file's; the caller's random state is not changed.
        with torch.random.fork_rng([]), LimitedSize(ROOM + 4 * sum(tensor.numel() for tensor in own.values())):
            if kind.__module__.startswith("kfit."):
                check_network_sizes(settings.get("init_args", {}))
            network: nn.Module = kind(**settings.get("init_args", {}))
            if kind.__module__.startswith("kfit."):
                check_drawing(network)
    except Exception as error:  # the user's class may raise anything
        reason = " ".join(str(error).split()) or type(error).__name__
        raise ValueError(f"{path}: {named} cannot be built from its card: {reason}") from error
    if not all(tensor.isfinite().all() for tensor in own.values()):
        raise ValueError(f"{path} holds numbers for the {name} that are not finite")
    try:
        network.load_state_dict(own)  # converts half to single precision
    except RuntimeError:
        raise ValueError(f"{path} does not fit its card: the weights are not those of the {name} named there") from None
    return network.float().eval()  # whatever torch's default type is


def _kind(class_path: str) -> Any:
    """Return a class by its path if it may be built, without importing anything."""
    module, _, kind = class_path.rpartition(".")
    if module.split(".")[0] == "kfit":
        return getattr(importlib.import_module(module), kind) if kind in OWN.get(module, ()) else None
    return vars(sys.modules[module]).get(kind) if module in sys.modules else None
