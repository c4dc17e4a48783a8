"""Packing training checkpoints to a model file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
import yaml  # type: ignore[import-untyped]
from torch import nn

from kfit import __version__
from kfit.data.rasterizer import DISTANCE
from kfit.data.shapes import VERSION
from kfit.geometry import CATEGORIES, Category
from kfit.models.released_model import released_model
from kfit.pose.card import Card
from kfit.pose.model_files import read_checkpoint, read_model, write_model

# Of recipes, what is of the machine alone.
FOLDERS = ("cache_dir", "default_root_dir", "ckpt_path", "config", "dirpath", "save_dir", "root_dir")


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
        checkpoint: checkpoint of `kfit.training.ConditionalVAE`, or with a category a released one; or a model's file,
            which gets another pose head and loses the measurements of the old one.
        out: path of the .safetensors file.
        pose_head: a checkpoint of `kfit.training.PoseTraining`, or a model's file, whose head is taken.
        pose_weight: weight of the pose head in a fit, at least 0.
        command: the training command, for the card.
        category: category of a released checkpoint, which does not name it; see
            `kfit.models.released_model.released_model`.

    Raises:
        FileNotFoundError: if a file is missing.
        ValueError: if a file is not such a checkpoint, or the pose head has another category.
    """
    if checkpoint.suffix == ".safetensors":
        networks, card = read_model(checkpoint)
        card = replace(card, accuracy={}, calibration={})
    elif category is None:
        networks, card = _trained(checkpoint, command)
    else:
        networks, card = released_model(checkpoint, category)
    if pose_head is not None:
        networks["pose_head"], described, of, trained = _head(pose_head)
        if of != card.category:
            raise ValueError(f"--pose-head is of category {of}, the checkpoint of {card.category}")
        with_head = {**card.networks, "pose_head": described}
        card = replace(card, networks=with_head, training={**card.training, "pose_head": trained})
    write_model(out, networks, replace(card, pose_weight=pose_weight))


def _trained(path: Path, command: str | None) -> tuple[dict[str, nn.Module], Card]:
    """Return networks of a checkpoint of `lightning fit`, and a card of their training."""
    networks, saved = read_checkpoint(path)
    model, data = saved["hyper_parameters"], _data_settings(saved)
    category = _category_of(data["category"])
    return networks, Card(
        category=category.name,
        networks={name: model[name] for name in networks},
        distance=DISTANCE,
        **Card.fields_of(category),
        training={
            "command": command or "unknown",
            "data": data | {"shapes_version": VERSION},
            "steps": int(saved["global_step"]),
            "pairs": int(saved["global_step"]) * int(data["batch_size"]),
            "kl_weight": model["kl_weight"],
            "kfit": __version__,
            "torch": torch.__version__,
            "provenance": _provenance(saved),
        },
    )


def _head(path: Path) -> tuple[nn.Module, Mapping[str, Any], str, Any]:
    """Return the pose head of a checkpoint or of a model: network, its entry in cards, category and training."""
    if path.suffix == ".safetensors":
        networks, card = read_model(path)
        if "pose_head" not in networks:
            raise ValueError(f"--pose-head: the model {path} has none")
        return networks["pose_head"], card.networks["pose_head"], card.category, card.training.get("pose_head")
    found, learned = read_checkpoint(path, ("pose_head",))
    training_data = _data_settings(learned)
    trained = {"data": training_data, "steps": int(learned["global_step"]), "provenance": _provenance(learned)}
    of = _category_of(training_data["category"]).name
    return found["pose_head"], learned["hyper_parameters"]["pose_head"], of, trained


def _category_of(saved: Any) -> Category:
    """Return the category that a checkpoint holds by name or by its fields."""
    if isinstance(saved, str) and saved in CATEGORIES:
        return CATEGORIES[saved]
    if not isinstance(saved, Mapping):
        raise ValueError(f"the checkpoint is of the category {str(saved)[:100]!r}, which it does not describe")
    return Category.of_dict(saved)


def _provenance(saved: dict[str, Any]) -> dict[str, Any] | None:
    """What `kfit.training.Provenance` wrote, with the recipe as plain values and without folders of the machine."""
    facts = saved.get("kfit")
    if not isinstance(facts, dict):
        return None
    recipe = yaml.safe_load(facts["recipe"]) if isinstance(facts.get("recipe"), str) else None
    return facts | {"recipe": _without_folders(recipe)}


def _without_folders(recipe: Any) -> Any:
    if isinstance(recipe, dict):
        return {key: _without_folders(value) for key, value in recipe.items() if key not in FOLDERS}
    return [_without_folders(value) for value in recipe] if isinstance(recipe, list) else recipe


def _data_settings(saved: dict[str, Any]) -> dict[str, Any]:
    """Return a checkpoint's settings of its data, without empty ones and those of the machine."""
    data = saved["datamodule_hyper_parameters"]
    return {k: v for k, v in data.items() if not k.startswith("_") and k != "cache_dir" and v is not None}
