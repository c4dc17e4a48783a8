"""Turn a training checkpoint into a model file that `kfit pose` and `kfit.load` take."""

from __future__ import annotations

import sys
from pathlib import Path

from jsonargparse import ArgumentParser, Namespace


def parser() -> ArgumentParser:
    """Arguments of ``kfit pack``."""
    parser = ArgumentParser(
        description="Pack a checkpoint of `lightning fit` as NAME.safetensors and NAME.json, its card.",
        epilog="example:  kfit pack lightning_logs/version_0/checkpoints/last.ckpt --out mug.safetensors",
    )
    parser.add_argument("checkpoint", type=str, help="a .ckpt file of kfit.training.ConditionalVAE")
    parser.add_argument("--out", type=str, required=True, help="file to write, ending in .safetensors")
    parser.add_argument("--command", type=str, default=None, help="the training command, for the card")
    return parser


def run(said: Namespace) -> None:
    """Write the two files."""
    out = Path(said.out)
    if out.suffix != ".safetensors":
        raise ValueError(f"--out must end in .safetensors, got {said.out}")
    import torch

    from kfit import __version__
    from kfit.data.rasterizer import DISTANCE
    from kfit.data.shapes import VERSION
    from kfit.geometry import CATEGORIES
    from kfit.models import Card, read_checkpoint, write_model

    networks, saved = read_checkpoint(Path(said.checkpoint))
    model, data = saved["hyper_parameters"], dict(saved["datamodule_hyper_parameters"])
    category = CATEGORIES[data["category"]]
    data = {k: v for k, v in data.items() if not k.startswith("_") and k != "cache_dir" and v is not None}
    card = Card(
        category=category.name,
        networks={name: model[name] for name in networks},
        distance=DISTANCE,
        unit_fraction=category.unit_fraction,
        elevation_deg=category.elevation_deg,
        axes=category.axes,
        symmetry=category.symmetry,
        mean_diagonal=category.mean_diagonal,
        training={
            "command": said.command or "not told",
            "data": data | {"shapes_version": VERSION},
            "steps": int(saved["global_step"]),
            "pairs": int(saved["global_step"]) * int(data["batch_size"]),
            "kl_weight": model["kl_weight"],
            "kfit": __version__,
            "torch": torch.__version__,
        },
    )
    write_model(out, networks, card)
    print(f"wrote {out} and {out.with_suffix('.json').name}", file=sys.stderr)
