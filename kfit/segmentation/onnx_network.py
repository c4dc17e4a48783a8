"""A network in an ONNX file that looks at one picture."""

from __future__ import annotations

import ast
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from kfit.core.check import check_text

LARGEST_FILE = 2 * 1024**3  # what protobuf can hold
LARGEST_SIDE = 4096
LONGEST_NAMES = 200_000
KINDS = {"float": np.float32, "float16": np.float16}


@dataclass(frozen=True)
class Socket:
    """An input or output of a network.

    Attributes:
        name: in the file.
        shape: for each axis a number, or None where any serves.
        kind: of its numbers, as ONNX Runtime spells it: "float", "float16", "int64".
    """

    name: str
    shape: tuple[int | None, ...]
    kind: str

    def __str__(self) -> str:
        return f"{self.name} ({', '.join('?' if side is None else str(side) for side in self.shape)}) {self.kind}"


class OnnxNetwork:
    """A network in an ONNX file that looks at one RGB picture, run by ONNX Runtime on the CPU.

    Args:
        path: of the file.

    Attributes:
        inputs, outputs: what goes in and comes out.
        layout: the same in words.
        sides: height and width of the picture, None where any serves.
        channels_last: whether the picture goes in as (1, H, W, 3) and not as (1, 3, H, W) or (3, H, W).

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: if ONNX Runtime cannot read it, or it takes something else than one picture of at most 4096 pixels
            a side.
    """

    def __init__(self, path: str | Path) -> None:
        check_text("path", path)
        self.path = Path(path)
        if not self.path.is_file():
            raise FileNotFoundError(f"there is no ONNX file {path}")
        if self.path.stat().st_size > LARGEST_FILE:
            raise ValueError(f"{path} has {self.path.stat().st_size:,} bytes, more than an ONNX file can have")
        import onnxruntime  # type: ignore[import-untyped]  # here, for loading it takes a third of a second

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = torch.get_num_threads()
        options.log_severity_level = 4  # what goes wrong is raised, and need not be printed as well
        try:
            self._session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
        except Exception as error:
            raise ValueError(f"{path} is no ONNX model that ONNX Runtime can read: {_line(error)}") from None
        self.inputs = [_socket(node) for node in self._session.get_inputs()]
        self.outputs = [_socket(node) for node in self._session.get_outputs()]
        self.layout = f"in: {_listed(self.inputs)}; out: {_listed(self.outputs)}"
        shape = self.inputs[0].shape if len(self.inputs) == 1 and self.inputs[0].kind in KINDS else ()
        self.channels_last = len(shape) == 4 and shape[3] == 3 and shape[1] != 3
        if self.channels_last:
            shape = (shape[0], shape[3], shape[1], shape[2])
        if len(shape) not in (3, 4) or shape[-3] not in (3, None) or shape[:-3] not in ((), (1,), (None,)):
            raise ValueError(
                f"{path} does not take one RGB picture, (3, H, W), (1, 3, H, W) or (1, H, W, 3) float ({self.layout})"
            )
        if max(side or 1 for side in shape[-2:]) > LARGEST_SIDE:
            raise ValueError(f"{path} takes pictures of more than {LARGEST_SIDE} pixels a side ({self.layout})")
        self.sides = (shape[-2], shape[-1])

    def names(self) -> dict[int, str] | None:
        """Class names by number, from the file's metadata as Ultralytics writes them; None without such.

        Raises:
            ValueError: if they cannot be read.
        """
        said = self._session.get_modelmeta().custom_metadata_map.get("names")
        if said is None:
            return None
        try:
            if len(said) > LONGEST_NAMES:
                raise ValueError(f"{len(said):,} characters are too many")
            found = ast.literal_eval(said)  # literals alone: nothing is run
            return {int(number): str(name) for number, name in dict(found).items()}
        except (ValueError, SyntaxError, TypeError, RecursionError, MemoryError) as error:
            raise ValueError(f"{self.path} names its classes in a way that cannot be read: {_line(error)}") from None

    def run(self, picture: NDArray[np.float32], names: list[str]) -> list[NDArray[Any]]:
        """Outputs of these names, from a picture (h, w, 3) in the range that the network expects.

        Raises:
            ValueError: if the network fails on it, or gives other axes than its file says.
        """
        source = self.inputs[0]
        axes_in_order = picture if self.channels_last else picture.transpose(2, 0, 1)
        values = np.ascontiguousarray(axes_in_order, KINDS[source.kind])
        try:
            found = self._session.run(names, {source.name: values[None] if len(source.shape) == 4 else values})
        except Exception as error:
            size = f"{picture.shape[1]} x {picture.shape[0]}"
            raise ValueError(f"{self.path} fails on a picture of {size} pixels: {_line(error)}") from None
        for name, part in zip(names, found, strict=True):
            axes = next(len(output.shape) for output in self.outputs if output.name == name)
            if np.ndim(part) != axes:
                raise ValueError(f"{self.path} gave {name} of shape {np.shape(part)}, its file says {axes} axes")
        return [np.asarray(part, np.float32) if part.dtype == np.float16 else np.asarray(part) for part in found]


def _socket(node: Any) -> Socket:
    shape = tuple(side if isinstance(side, int) and side > 0 else None for side in node.shape or ())
    return Socket(str(node.name), shape, str(node.type).removeprefix("tensor(").removesuffix(")"))


def _listed(sockets: list[Socket]) -> str:
    return ", ".join(map(str, sockets[:8])) + (f" and {len(sockets) - 8} more" if len(sockets) > 8 else "")


def _line(error: BaseException) -> str:
    words = " ".join(str(error).split()) or type(error).__name__
    return words if len(words) <= 200 else f"{words[:200]} …"
