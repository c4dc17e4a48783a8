"""Write a model's networks as ONNX files.

Generator, encoder and feature network each get a file, with any number of rows.
"""

from __future__ import annotations

from pathlib import Path

from jsonargparse import ArgumentParser, Namespace

from kfit.runtime.console import log, progress


def parser() -> ArgumentParser:
    """Arguments of ``kfit export``."""
    parser = ArgumentParser(
        description="Write DIR/generator.onnx, DIR/encoder.onnx and DIR/features.onnx (the fit's feature network), "
        "which take any number of rows. kfit.generators.OnnxGenerator fits through the first; ONNX Runtime runs all.",
        epilog="example:\n  kfit export mug --out mug_onnx",
    )
    parser.add_argument("model", type=str, help="a bundled model's category, or a .safetensors file")
    parser.add_argument("--out", type=str, required=True, help="folder to write to", metavar="DIR")
    return parser


def run(args: Namespace) -> None:
    """Write the files and name them."""
    from kfit.models import load
    from kfit.models.export import export_model

    model = load(args.model)
    with progress() as bar:
        task = bar.add_task("exporting", total=3)
        paths = export_model(model, Path(args.out), lambda done: bar.update(task, completed=done))
    for path in paths:
        log.info("wrote %s", path)
