"""A network in an ONNX file that takes one picture."""

from __future__ import annotations

import ast
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from kfit.core.arguments import check_arguments

LARGEST_FILE = 2 * 1024**3  # what protobuf can hold
LARGEST_SIDE = 4096
LONGEST_NAMES = 200_000
KINDS = {"float": np.float32, "float16": np.float16}
# What a picture may take: seconds, as an endless loop is well-formed, and bytes of all networks together.
LONGEST_RUN = 300.0
LARGEST_MEMORY = 4 * 1024**3
MOST_NUMBERS = 2**28  # of an output


@dataclass(frozen=True)
class Socket:
    """An input or output of a network.

    Attributes:
        name: in the file.
        shape: for each axis a number, or None for any.
        kind: data type of its numbers, as ONNX Runtime spells it: "float", "float16", "int64".
    """

    name: str
    shape: tuple[int | None, ...]
    kind: str

    @property
    def is_float(self) -> bool:
        """Whether its numbers are of floating point, so neither text, truth values nor integers."""
        return self.kind in ("float", "float16", "double")

    def __str__(self) -> str:
        return f"{self.name} ({', '.join('?' if side is None else str(side) for side in self.shape)}) {self.kind}"


class OnnxNetwork:
    """A network in an ONNX file that takes one RGB picture, run by ONNX Runtime on the CPU.

    The file is untrusted: a picture may take 300 seconds, and all networks together 4 GB of memory.

    Args:
        path: path of the file.

    Attributes:
        inputs, outputs: names, shapes and types.
        layout: the same in words.
        sides: height and width of the picture, None for any.
        channels_last: whether the input is (1, H, W, 3), instead of (1, 3, H, W) or (3, H, W).

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: if ONNX Runtime cannot read it, or its input is not one picture of at most 4096 pixels
            a side.
    """

    def __init__(self, path: str | Path) -> None:
        check_arguments(OnnxNetwork, locals())
        self.path = Path(path)
        if not self.path.is_file():
            raise FileNotFoundError(f"there is no ONNX file {path}")
        if self.path.stat().st_size > LARGEST_FILE:
            raise ValueError(f"{path} has {self.path.stat().st_size:,} bytes, more than an ONNX file can have")
        import onnxruntime  # type: ignore[import-untyped]  # here, for loading it takes a third of a second

        onnxruntime.disable_telemetry_events()  # on by default
        _bound_memory()
        options = onnxruntime.SessionOptions()
        options.add_session_config_entry("session.use_env_allocators", "1")
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
        """Return class names by number, from the file's metadata as Ultralytics writes them, or None.

        Raises:
            ValueError: if they cannot be read.
        """
        text = self._session.get_modelmeta().custom_metadata_map.get("names")
        if text is None:
            return None
        try:
            if len(text) > LONGEST_NAMES:
                raise ValueError(f"{len(text):,} characters are too many")
            found = ast.literal_eval(text)  # literals alone: nothing is run
            return {int(number): str(name) for number, name in dict(found).items()}
        except (ValueError, SyntaxError, TypeError, RecursionError, MemoryError) as error:
            raise ValueError(f"{self.path} names its classes in a way that cannot be read: {_line(error)}") from None

    def run(self, picture: NDArray[np.float32], names: list[str]) -> list[NDArray[Any]]:
        """Return the outputs of these names for a picture (h, w, 3) in the range of the network.

        Raises:
            ValueError: if the network fails on it, or returns other axes than its file declares.
        """
        source = self.inputs[0]
        axes_in_order = picture if self.channels_last else picture.transpose(2, 0, 1)
        values = np.ascontiguousarray(axes_in_order, KINDS[source.kind])
        size = f"a picture of {picture.shape[1]} x {picture.shape[0]} pixels"
        with _time_limit(LONGEST_RUN) as limit:
            try:
                arrays = {source.name: values[None] if len(source.shape) == 4 else values}
                found = self._session.run(names, arrays, limit)
            except Exception as error:
                if limit.terminate:
                    raise ValueError(f"{self.path} takes more than {LONGEST_RUN:g} seconds for {size}") from None
                raise ValueError(f"{self.path} fails on {size}: {_line(error)}") from None
        for name, part in zip(names, found, strict=True):
            (shape,) = (output.shape for output in self.outputs if output.name == name)
            sides = zip(shape, np.shape(part), strict=False)
            if np.ndim(part) != len(shape) or any(side not in (None, came) for side, came in sides):
                declared = ", ".join("?" if side is None else str(side) for side in shape)
                raise ValueError(f"{self.path} gave {name} of shape {np.shape(part)}, its file declares ({declared})")
            if np.size(part) > MOST_NUMBERS:
                raise ValueError(
                    f"{self.path} gave {name} of shape {np.shape(part)}, more than {MOST_NUMBERS:,} numbers"
                )
        return [part.astype(np.float32) if part.dtype in (np.float16, np.float64) else part for part in found]


@lru_cache(maxsize=1)
def _bound_memory() -> None:
    """Give ONNX Runtime one allocator for all networks, which refuses more than `LARGEST_MEMORY`."""
    import onnxruntime

    where = onnxruntime.OrtMemoryInfo(
        "Cpu", onnxruntime.OrtAllocatorType.ORT_ARENA_ALLOCATOR, 0, onnxruntime.OrtMemType.DEFAULT
    )
    limits = onnxruntime.OrtArenaCfg(
        {"max_mem": LARGEST_MEMORY, "arena_extend_strategy": 1}
    )  # the requested number of bytes
    onnxruntime.create_and_register_allocator(where, limits)


@contextmanager
def _time_limit(seconds: float) -> Iterator[Any]:
    """Options of a run that end it after so many seconds, between two operations or turns of a loop."""
    import onnxruntime

    limit = onnxruntime.RunOptions()
    limit.log_severity_level = 4
    timer = threading.Timer(seconds, setattr, (limit, "terminate", True))
    timer.daemon = True
    timer.start()
    try:
        yield limit
    finally:
        timer.cancel()


def _socket(node: Any) -> Socket:
    shape = tuple(side if isinstance(side, int) and side > 0 else None for side in node.shape or ())
    return Socket(str(node.name), shape, str(node.type).removeprefix("tensor(").removesuffix(")"))


def _listed(sockets: list[Socket]) -> str:
    return ", ".join(map(str, sockets[:8])) + (f" and {len(sockets) - 8} more" if len(sockets) > 8 else "")


def _line(error: BaseException) -> str:
    words = " ".join(str(error).split()) or type(error).__name__
    return words if len(words) <= 200 else f"{words[:200]} …"
