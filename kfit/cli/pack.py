"""Turn a training checkpoint into a model file that `kfit pose` and `kfit.load` take."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from jsonargparse import ArgumentParser, Namespace

from kfit.runtime.console import log

if TYPE_CHECKING:
    from torch import nn

    from kfit.pose import Card


def parser() -> ArgumentParser:
    """Arguments of ``kfit pack``."""
    parser = ArgumentParser(
        description="Pack a checkpoint of `lightning fit` as NAME.safetensors, with its card in the metadata.",
        epilog="examples:\n  kfit pack lightning_logs/version_0/checkpoints/last.ckpt --out mug.safetensors\n"
        "  kfit pack last.ckpt --pose-head lightning_logs/version_1/checkpoints/last.ckpt --out mug.safetensors\n"
        "  kfit pack model_latest.pth --category laptop --out laptop.safetensors",
    )
    parser.add_argument(
        "checkpoint",
        type=str,
        help="a .ckpt file of kfit.training.ConditionalVAE, or with --category the paper's authors' model_latest.pth",
    )
    parser.add_argument(
        "--category",
        type=str,
        default=None,
        metavar="NAME",
        help="category of a model_latest.pth, which does not name it itself",
    )
    parser.add_argument(
        "--pose-head",
        type=str,
        default=None,
        metavar="FILE",
        help="a .ckpt file of kfit.training.PoseTraining, or a model's .safetensors file, whose head is taken",
    )
    parser.add_argument("--pose-weight", type=float, default=2.0, help="how much a fit heeds the pose head")
    parser.add_argument("--out", type=str, required=True, metavar="FILE.safetensors", help="file to write")
    parser.add_argument("--command", type=str, default=None, metavar="WORDS", help="the training command, for the card")
    return parser


def run(args: Namespace) -> None:
    """Write the file."""
    out = Path(args.out)
    if out.suffix != ".safetensors":
        raise ValueError(f"--out must end in .safetensors, got {args.out}")
    if args.pose_weight < 0:
        raise ValueError(f"--pose-weight must be at least 0, got {args.pose_weight}")
    from kfit.models import released_model, write_model

    if args.category is None:
        networks, card = _trained(Path(args.checkpoint), args.command)
    else:
        networks, card = released_model(args.checkpoint, args.category)
    card.pose_weight = args.pose_weight
    if args.pose_head is not None:
        networks["pose_head"], card.networks["pose_head"], of, trained = _head(Path(args.pose_head))
        if of != card.category:
            raise ValueError(f"--pose-head is of category {of}, the checkpoint of {card.category}")
        card.training["pose_head"] = trained
    write_model(out, networks, card)
    log.info("wrote %s", out)


def _trained(path: Path, command: str | None) -> tuple[dict[str, nn.Module], Card]:
    """Networks of a checkpoint of `lightning fit`, and a card of their training."""
    import torch

    from kfit import __version__
    from kfit.data.rasterizer import DISTANCE
    from kfit.data.shapes import VERSION
    from kfit.geometry import CATEGORIES
    from kfit.models import read_checkpoint
    from kfit.pose import Card

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
            "command": command or "not told",
            "data": data | {"shapes_version": VERSION},
            "steps": int(saved["global_step"]),
            "pairs": int(saved["global_step"]) * int(data["batch_size"]),
            "kl_weight": model["kl_weight"],
            "kfit": __version__,
            "torch": torch.__version__,
        },
    )


def _head(path: Path) -> tuple[nn.Module, dict[str, Any], str, Any]:
    """The pose head of a checkpoint or of a model: network, its name in cards, category and training."""
    from kfit.models import read_checkpoint, read_model

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
