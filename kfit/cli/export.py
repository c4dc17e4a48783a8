"""Write a model's networks as ONNX files.

Generator, encoder and feature network each get a file, with any number of rows.
"""

from __future__ import annotations

import sys
from pathlib import Path

from jsonargparse import ArgumentParser, Namespace


def parser() -> ArgumentParser:
    """Arguments of ``kfit export``."""
    parser = ArgumentParser(
        description="Write DIR/generator.onnx, DIR/encoder.onnx and DIR/features.onnx (the fit's feature network), "
        "which take any number of rows. kfit.generators.OnnxGenerator fits through the first; ONNX Runtime runs all.",
        epilog="example:  kfit export mug --out mug_onnx",
    )
    parser.add_argument("model", type=str, help="a bundled model's category, or a .safetensors file")
    parser.add_argument("--out", type=str, required=True, help="folder to write to", metavar="DIR")
    return parser


def run(said: Namespace) -> None:
    """Write the files and name them."""
    from kfit.models import load
    from kfit.models.export import export_model

    for path in export_model(load(said.model), Path(said.out)):
        print(f"wrote {path}", file=sys.stderr)
