"""Packing training checkpoints to a model file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch
from torch import nn

from kfit import __version__
from kfit.data.rasterizer import DISTANCE
from kfit.data.shapes import VERSION
from kfit.geometry import CATEGORIES
from kfit.models.files import read_checkpoint, read_model, write_model
from kfit.models.released_model import released_model
from kfit.pose.card import Card


def pack(
    checkpoint: Path,
    out: Path,
    pose_head: Path | None = None,
    pose_weight: float = 2.0,
    command: str | None = None,
    category: str | None = None,
) -> None:
    """Write a model file.

    Args:
        checkpoint: of `kfit.training.ConditionalVAE`, or with a category a released one; or a model's file, which
            gets another pose head and loses the measurements of the old one.
        out: path of the .safetensors file.
        pose_head: a checkpoint of `kfit.training.PoseTraining`, or a model's file, whose head is taken.
        pose_weight: of the pose head in a fit, at least 0.
        command: the training command, for the card.
        category: of a released checkpoint, which does not name it; see `kfit.models.released_model.released_model`.

    Raises:
        FileNotFoundError: if a file is missing.
        ValueError: if a file is not such a checkpoint, or the pose head has another category.
    """
    if checkpoint.suffix == ".safetensors":
        networks, card = read_model(checkpoint)
        card.accuracy, card.calibration = {}, {}
    elif category is None:
        networks, card = _trained(checkpoint, command)
    else:
        networks, card = released_model(checkpoint, category)
    card.pose_weight = pose_weight
    if pose_head is not None:
        networks["pose_head"], card.networks["pose_head"], of, trained = _head(pose_head)
        if of != card.category:
            raise ValueError(f"--pose-head is of category {of}, the checkpoint of {card.category}")
        card.training["pose_head"] = trained
    write_model(out, networks, card)


def _trained(path: Path, command: str | None) -> tuple[dict[str, nn.Module], Card]:
    """Return networks of a checkpoint of `lightning fit`, and a card of their training."""
    networks, saved = read_checkpoint(path)
    model, data = saved["hyper_parameters"], _told(saved)
    category = CATEGORIES[data["category"]]
    return networks, Card(
        category=category.name,
        networks={name: model[name] for name in networks},
        distance=DISTANCE,
        unit_fraction=category.unit_fraction,
        elevation_deg=category.elevation_deg,
        axes=category.axes,
        symmetry=category.symmetry,
        mean_diagonal=category.mean_diagonal,
        training={
            "command": command or "unknown",
            "data": data | {"shapes_version": VERSION},
            "steps": int(saved["global_step"]),
            "pairs": int(saved["global_step"]) * int(data["batch_size"]),
            "kl_weight": model["kl_weight"],
            "kfit": __version__,
            "torch": torch.__version__,
        },
    )


def _head(path: Path) -> tuple[nn.Module, dict[str, Any], str, Any]:
    """Return the pose head of a checkpoint or of a model: network, its entry in cards, category and training."""
    if path.suffix == ".safetensors":
        networks, card = read_model(path)
        if "pose_head" not in networks:
            raise ValueError(f"--pose-head: the model {path} has none")
        return networks["pose_head"], card.networks["pose_head"], card.category, card.training.get("pose_head")
    found, learned = read_checkpoint(path, ("pose_head",))
    told = _told(learned)
    trained = {"data": told, "steps": int(learned["global_step"])}
    return found["pose_head"], learned["hyper_parameters"]["pose_head"], told["category"], trained


def _told(saved: dict[str, Any]) -> dict[str, Any]:
    """What a checkpoint tells of its data, without what says nothing or is of the machine alone."""
    data = saved["datamodule_hyper_parameters"]
    return {k: v for k, v in data.items() if not k.startswith("_") and k != "cache_dir" and v is not None}
