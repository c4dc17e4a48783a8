"""A generator that was exported to ONNX."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from kfit.core import Angle, Bounded, Generator, Positive, Real, Rendering, Variable
from kfit.core.arguments import check_arguments
from kfit.core.check import check_names, check_shape

SPACES = {space.__name__: space for space in (Real, Positive, Bounded, Angle)}
FIELDS = ("image", "mask", "depth", "weight")


class OnnxGenerator(Generator):
    """Draw with ONNX Runtime what `kfit export` wrote, without gradients and without the generator's code.

    Its variables are read from the file. It draws on the CPU in single precision, and returns type and device of its
    inputs. Fit it with an optimizer that needs no gradients.

    Args:
        path: a ``generator.onnx`` of `kfit export`.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: if it is not a generator that kfit exported.
        RuntimeError: when drawing, if a gradient of a value is requested.

    Example:
        >>> from kfit.generators import OnnxGenerator
        >>> OnnxGenerator("missing.onnx")
        Traceback (most recent call last):
        FileNotFoundError: no ONNX file at missing.onnx; `kfit export` writes generator.onnx
    """

    def __init__(self, path: str | Path) -> None:
        super().__init__()
        check_arguments(OnnxGenerator, locals())
        if not Path(path).is_file():
            raise FileNotFoundError(f"no ONNX file at {path}; `kfit export` writes generator.onnx")
        import onnxruntime  # type: ignore[import-untyped]  # imported here, because it takes 0.3 s

        onnxruntime.disable_telemetry_events()  # on by default
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = torch.get_num_threads()
        try:
            self.session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
            described = json.loads(self.session.get_modelmeta().custom_metadata_map["kfit_variables"])
            self.variables = {name: _variable(**words) for name, words in described.items()}
        except Exception as error:
            reason = " ".join(str(error).split()) or type(error).__name__
            raise ValueError(f"{path} is no generator that `kfit export` wrote: {reason}") from None
        self.fields = [output.name for output in self.session.get_outputs()]
        if self.fields[:1] != ["image"] or not set(self.fields) <= set(FIELDS):
            raise ValueError(f"{path} must draw {', '.join(FIELDS)}, image first; it draws {', '.join(self.fields)}")

    def __deepcopy__(self, memo: dict[int, Any]) -> OnnxGenerator:
        return self  # it is immutable, and a session cannot be copied

    def forward(self, **values: Tensor) -> Rendering:
        check_names("OnnxGenerator", values, self.variables, complete=True)
        if torch.is_grad_enabled() and any(value.requires_grad for value in values.values()):
            raise RuntimeError(
                "a generator in ONNX has no gradients: fit it with an optimizer that needs none, such as "
                "kfit.optimizers.CMAES"
            )
        like = next(iter(values.values()))
        for name, value in values.items():
            check_shape(name, value, ("N", *self.variables[name].shape))
        inputs = {name: value.detach().cpu().float().contiguous().numpy() for name, value in values.items()}
        drawn = self.session.run(self.fields, inputs)
        return Rendering(**{n: torch.from_numpy(a).to(like) for n, a in zip(self.fields, drawn, strict=True)})


def _variable(shape: list[int], space: str, settings: dict[str, float]) -> Variable:
    return Variable(tuple(shape), SPACES[space](**settings))
