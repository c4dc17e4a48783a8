"""Turn a training checkpoint into a model file that `kfit pose` and `kfit.load` take."""

from __future__ import annotations

from pathlib import Path

from jsonargparse import ArgumentParser, Namespace

from kfit.runtime.console import log


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
        help="a .ckpt file of kfit.training.ConditionalVAE, a .safetensors file that gets another pose head, or with "
        "--category the paper's authors' model_latest.pth",
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
    from kfit.models.pack import pack

    head = None if args.pose_head is None else Path(args.pose_head)
    pack(Path(args.checkpoint), out, head, args.pose_weight, args.command, args.category)
    log.info("wrote %s", out)
