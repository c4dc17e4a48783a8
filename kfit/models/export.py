"""Networks as ONNX files, to run without kfit and without torch."""

from __future__ import annotations

import json
import logging
import warnings
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from kfit.core import Angle, Bounded, Encoder, Generator, Positive, Real, frozen
from kfit.features import EfficientNetLite0
from kfit.features.network import FeatureNetwork
from kfit.pose.category_model import CategoryModel
from kfit.runtime.atomic_write import atomic_write

OPSET = 20  # the first with GridSample of volumes


def export_model(model: CategoryModel, folder: Path, on_file: Callable[[int], None] = lambda done: None) -> list[Path]:
    """Write ``generator.onnx``, ``encoder.onnx`` and ``features.onnx``, the network of the model's own fit.

    ``on_file`` is called with the number of written files.
    See `export_generator`, `export_encoder` and `export_features`.
    """
    paths = [folder / f"{name}.onnx" for name in ("generator", "encoder", "features")]
    export_generator(model.generator, paths[0])
    on_file(1)
    with torch.no_grad():
        one = {name: torch.zeros(1, *variable.shape) for name, variable in model.generator.variables.items()}
        size = frozen(model.generator)(**one).image.shape[-1]
    export_encoder(model.encoder, paths[1], size)
    on_file(2)
    export_features(EfficientNetLite0(), paths[2], size)
    on_file(3)
    return paths


def export_generator(generator: Generator, path: Path) -> None:
    """Write a generator as ONNX: variables in (N, \\*shape), ``image``, ``mask`` and ``depth`` out, N free.

    Any generator works, a `SimilarityWarp` too. The file has the variables, so that
    `kfit.generators.OnnxGenerator` can be fitted.

    Raises:
        ImportError: without the package onnxscript.
        ValueError: if a variable has a custom space.
    """
    described = {}
    for name, variable in generator.variables.items():
        if type(variable.space) not in (Real, Positive, Bounded, Angle):
            raise ValueError(
                f"{name!r} lives in the space {type(variable.space).__name__}, which ONNX files cannot store"
            )
        kind, settings = type(variable.space).__name__, asdict(variable.space)  # type: ignore[call-overload]
        described[name] = {"shape": variable.shape, "space": kind, "settings": settings}
    # Two rows: with one, the exporter takes what depends on N for fixed.
    raw = {name: 0.1 * torch.ones(2, *variable.shape) for name, variable in generator.variables.items()}
    example = tuple(generator.variables[name].space.to_value(value) for name, value in raw.items())
    drawing = _Drawing(frozen(generator))
    names = drawing.fields_of(*example)
    _write(drawing, example, list(described), names, path, {"kfit_variables": json.dumps(described)})


def export_encoder(encoder: Encoder, path: Path, image_size: int) -> None:
    """Write an encoder as ONNX: ``image`` (N, 3, S, S) in [0, 1] in, ``mean`` and ``log_variance`` (N, D) out.

    Raises:
        ImportError: without the package onnxscript.
    """
    _write(frozen(encoder), (torch.rand(2, 3, image_size, image_size),), ["image"], ["mean", "log_variance"], path)


def export_features(network: FeatureNetwork, path: Path, image_size: int) -> None:
    """Write a feature network as ONNX: ``image`` (N, 3, S, S) in [0, 1] in, features (N, C, h, w) out by layer.

    Raises:
        ImportError: without the package onnxscript.
    """
    image = torch.rand(2, 3, image_size, image_size)
    with torch.no_grad():
        layers = list(network(image))
    _write(_Layers(frozen(network)), (image,), ["image"], layers, path)


class _Drawing(nn.Module):
    def __init__(self, generator: Generator) -> None:
        super().__init__()
        self.generator = generator
        self.eval()

    def forward(self, *values: Tensor) -> tuple[Tensor, ...]:
        drawn = self.generator(**dict(zip(self.generator.variables, values, strict=True)))
        return tuple(field for field in (drawn.image, drawn.mask, drawn.depth, drawn.weight) if field is not None)

    def fields_of(self, *values: Tensor) -> list[str]:
        with torch.no_grad():
            drawn = self.generator(**dict(zip(self.generator.variables, values, strict=True)))
        return [name for name in ("image", "mask", "depth", "weight") if getattr(drawn, name) is not None]


class _Layers(nn.Module):
    def __init__(self, network: FeatureNetwork) -> None:
        super().__init__()
        self.network = network
        self.eval()

    def forward(self, image: Tensor) -> tuple[Tensor, ...]:
        return tuple(self.network(image).values())


def _write(
    network: nn.Module,
    example: tuple[Tensor, ...],
    inputs: Sequence[str],
    outputs: Sequence[str],
    path: Path,
    metadata: dict[str, str] | None = None,
) -> None:
    try:
        import onnxscript  # noqa: F401
    except ImportError:
        raise ImportError("exporting to ONNX needs the package onnxscript: pip install 'kfit[export]'") from None
    rows = torch.export.Dim("rows")
    shapes = tuple({0: rows} for _ in example)
    logger = logging.getLogger("torch.onnx")
    level = logger.level
    logger.setLevel(logging.ERROR)  # it would say that torchvision is not installed
    try:
        # The exporter's own code uses what torch deprecates.
        with warnings.catch_warnings(), torch.no_grad():
            warnings.simplefilter("ignore")
            program: Any = torch.onnx.export(
                network,
                example,
                dynamo=True,
                opset_version=OPSET,
                input_names=inputs,
                output_names=outputs,
                dynamic_shapes=(shapes,) if isinstance(network, _Drawing) else shapes,
                verbose=False,
            )
    finally:
        logger.setLevel(level)
    graph = program.model.graph
    outer = {id(value) for value in (*graph.inputs, *graph.outputs)}
    for node in graph:
        for value in node.outputs:
            # The exporter gives our names to inputs and outputs without asking whether a value within has them.
            if value.name in {*inputs, *outputs} and id(value) not in outer:
                value.name = f"{value.name}_within"
    program.model.metadata_props.update(metadata or {})
    atomic_write(path.parent, {path.name: program.save})
