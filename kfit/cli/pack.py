"""Turn a training checkpoint into a model file that `kfit pose` and `kfit.load` take."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from jsonargparse import ArgumentParser, Namespace

from kfit.runtime.console import log

if TYPE_CHECKING:
    from torch import nn


def parser() -> ArgumentParser:
    """Arguments of ``kfit pack``."""
    parser = ArgumentParser(
        description="Pack a checkpoint of `lightning fit` as NAME.safetensors and NAME.json, its card.",
        epilog="examples:\n  kfit pack lightning_logs/version_0/checkpoints/last.ckpt --out mug.safetensors\n"
        "  kfit pack last.ckpt --pose-head lightning_logs/version_1/checkpoints/last.ckpt --out mug.safetensors",
    )
    parser.add_argument("checkpoint", type=str, help="a .ckpt file of kfit.training.ConditionalVAE")
    parser.add_argument(
        "--pose-head",
        type=str,
        default=None,
        metavar="FILE",
        help="a .ckpt file of kfit.training.PoseTraining, or a model's .safetensors file, whose head is taken",
    )
    parser.add_argument("--pose-weight", type=float, default=2.0, help="how much a fit heeds the pose head")
    parser.add_argument(
        "--out", type=str, required=True, metavar="FILE.safetensors", help="file to write; its card lies beside it"
    )
    parser.add_argument("--command", type=str, default=None, metavar="WORDS", help="the training command, for the card")
    return parser


def run(args: Namespace) -> None:
    """Write the two files."""
    out = Path(args.out)
    if out.suffix != ".safetensors":
        raise ValueError(f"--out must end in .safetensors, got {args.out}")
    if args.pose_weight < 0:
        raise ValueError(f"--pose-weight must be at least 0, got {args.pose_weight}")
    import torch

    from kfit import __version__
    from kfit.data.rasterizer import DISTANCE
    from kfit.data.shapes import VERSION
    from kfit.geometry import CATEGORIES
    from kfit.models import read_checkpoint, write_model
    from kfit.pose import Card

    networks, saved = read_checkpoint(Path(args.checkpoint))
    model, data = saved["hyper_parameters"], _told(saved)
    category = CATEGORIES[data["category"]]
    named = {name: model[name] for name in networks}
    also: dict[str, object] = {}
    if args.pose_head is not None:
        networks["pose_head"], named["pose_head"], of, trained = _head(Path(args.pose_head))
        if of != category.name:
            raise ValueError(f"--pose-head is of category {of}, the checkpoint of {category.name}")
        also = {"pose_head": trained}
    card = Card(
        category=category.name,
        networks=named,
        distance=DISTANCE,
        unit_fraction=category.unit_fraction,
        elevation_deg=category.elevation_deg,
        axes=category.axes,
        symmetry=category.symmetry,
        mean_diagonal=category.mean_diagonal,
        pose_weight=args.pose_weight,
        training={
            "command": args.command or "not told",
            "data": data | {"shapes_version": VERSION},
            "steps": int(saved["global_step"]),
            "pairs": int(saved["global_step"]) * int(data["batch_size"]),
            "kl_weight": model["kl_weight"],
            "kfit": __version__,
            "torch": torch.__version__,
        }
        | also,
    )
    write_model(out, networks, card)
    log.info("wrote %s and %s", out, out.with_suffix(".json").name)


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
