"""Pickles of arrays and plain values, read without running anything that they ask for."""

from __future__ import annotations

import io
import pickle
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kfit.runtime.atomic_write import atomic_write

# Booleans, integers, floats, bytes and text: dtypes whose memory holds values and no pointers.
_KINDS = "biufSU"


def load_pickle(path: str | Path) -> Any:
    """Read a pickle of NumPy arrays, lists, tuples, sets, dicts, text, bytes, numbers, True, False and None.

    A pickle is a program that may call any function by name. Here the names that NumPy's own pickles use stand for
    functions that check and rebuild plain arrays, and every other name is refused before anything is called.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: if it asks for anything else, or is damaged or no pickle.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    try:
        return _plain(_Unpickler(io.BytesIO(path.read_bytes()), encoding="latin1").load())
    except _RefusedError as error:
        raise ValueError(f"{path} asks for {error}, which is neither an array nor a plain value: not read") from None
    except (
        pickle.UnpicklingError, EOFError, ValueError, TypeError, AttributeError, LookupError, ImportError,
        OverflowError, MemoryError, RecursionError,
    ) as error:  # fmt: skip
        raise ValueError(f"{path} is damaged or no pickle ({error or type(error).__name__})") from None


def dump_pickle(path: str | Path, value: Any) -> None:
    """Write a pickle that Python 3 with any NumPy reads, the whole file or none.

    NumPy 2 names its internals otherwise than NumPy 1, which knows only the old names; NumPy 2 knows both.
    """
    path = Path(path)
    # The third protocol spells names in full, ended by a newline.
    written = pickle.dumps(value, protocol=3)
    written = written.replace(b"cnumpy._core.multiarray\n", b"cnumpy.core.multiarray\n")
    atomic_write(path.parent, {path.name: lambda place: place.write_bytes(written)})


class _RefusedError(Exception):
    """A name that no pickle of plain values needs."""


class _Dtype:
    """Stands for a dtype: its real counterpart's state could say that its memory holds pointers."""

    def __init__(self, code: str, *_: object) -> None:
        dtype = np.dtype(code) if isinstance(code, str) else None
        if dtype is None or dtype.kind not in _KINDS or dtype.names or dtype.subdtype:
            raise _RefusedError(f"arrays of {code!r}")
        self.dtype = dtype

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        order, inner = state[1], state[2:5]
        if order not in ("<", ">", "|", "=") or inner != (None, None, None):
            raise _RefusedError("a structured dtype")
        self.dtype = self.dtype.newbyteorder(order)


class _Array:
    """Stands for an array until its state has come."""

    def __init__(self, *_: object) -> None:
        self.value: NDArray[Any] = np.zeros(0)

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        _, shape, dtype, in_columns, raw = state
        self.value = _rebuilt(raw, dtype, shape, "F" if in_columns else "C")


def _rebuilt(raw: bytes | bytearray | str, dtype: object, shape: tuple[int, ...], order: Any) -> NDArray[Any]:
    """An array from its bytes, which Python 2 wrote as text."""
    if not isinstance(dtype, _Dtype):
        raise _RefusedError("an array without a dtype")
    data = raw.encode("latin1") if isinstance(raw, str) else bytes(raw)
    return np.frombuffer(data, dtype.dtype).reshape(shape, order=order).copy(order="K")


def _scalar(dtype: object, raw: bytes | str) -> Any:
    return _rebuilt(raw, dtype, (), "C")[()]


def _encode(text: str, encoding: str) -> bytes:
    """How the second protocol writes bytes."""
    if encoding != "latin1":
        raise _RefusedError(f"the encoding {encoding!r}")
    return text.encode("latin1")


_ALLOWED: dict[tuple[str, str], object] = {
    ("numpy", "dtype"): _Dtype,
    ("numpy", "ndarray"): _Array,
    ("_codecs", "encode"): _encode,
    **{("numpy.core.multiarray".replace("core", core), "_reconstruct"): _Array for core in ("core", "_core")},
    **{("numpy.core.multiarray".replace("core", core), "scalar"): _scalar for core in ("core", "_core")},
    **{("numpy.core.numeric".replace("core", core), "_frombuffer"): _rebuilt for core in ("core", "_core")},
    **{("builtins", kind.__name__): kind for kind in (bool, int, float, str, bytes, bytearray, set, frozenset)},
}


class _Unpickler(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        module = "builtins" if module == "__builtin__" else module
        if (module, name) not in _ALLOWED:
            raise _RefusedError(f"{module}.{name}")
        return _ALLOWED[module, name]

    def persistent_load(self, pid: object) -> Any:
        raise _RefusedError("something outside the file")


def _plain(value: Any) -> Any:
    """The value with arrays in the place of what stood for them."""
    if isinstance(value, _Array):
        return value.value
    if isinstance(value, _Dtype):
        return value.dtype
    if isinstance(value, dict):
        return {_plain(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, set, frozenset)):
        return type(value)(_plain(item) for item in value)
    if isinstance(value, (bool, int, float, str, bytes, bytearray, np.ndarray, np.generic, type(None))):
        return value
    raise _RefusedError(f"a {type(value).__name__}")
