"""Pickles of arrays and plain values, read without running code of the file."""

from __future__ import annotations

import io
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kfit.data.pickle_limits import DEEPEST, MOST_ITEMS, check_pickle
from kfit.runtime.atomic_write import atomic_write

# Booleans, integers, floats, bytes and text: dtypes whose memory holds values and no pointers.
_KINDS = "biufSU"


def load_pickle(path: str | Path) -> Any:
    """Read a pickle of NumPy arrays, lists, tuples, sets, dicts, text, bytes, numbers, True, False and None.

    A pickle is a program that may call any function by name. Here the names of NumPy's pickles are replaced by
    functions that check and rebuild plain arrays, and every other name is refused before anything is called.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: if it holds anything else, unfolds to far more than its bytes, or is damaged or not a pickle.

    Example:
        >>> from kfit.data import dump_pickle, load_pickle
        >>> dump_pickle("values.pkl", {"scores": [0.9, 0.8]})
        >>> load_pickle("values.pkl")
        {'scores': [0.9, 0.8]}
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    content = path.read_bytes()
    try:
        check_pickle(content)
        return _Plain().of(_Unpickler(io.BytesIO(content), encoding="latin1").load())
    except _RefusedError as error:
        raise ValueError(f"{path} asks for {error}, which is neither an array nor a plain value: not read") from None
    except (
        pickle.UnpicklingError, EOFError, ValueError, TypeError, AttributeError, LookupError, ImportError,
        OverflowError, MemoryError, RecursionError,
    ) as error:  # fmt: skip
        raise ValueError(f"{path} is damaged or no pickle ({error or type(error).__name__})") from None


def dump_pickle(path: str | Path, value: Any) -> None:
    """Write a pickle atomically that Python 3 with any NumPy reads.

    NumPy 2 renamed its internals and reads both names, NumPy 1 only the old names, which are written.

    Example:
        >>> import numpy as np
        >>> from kfit.data import dump_pickle, load_pickle
        >>> dump_pickle("array.pkl", np.arange(3))
        >>> load_pickle("array.pkl").sum()
        np.int64(3)
    """
    path = Path(path)
    # The third protocol spells names in full, ended by a newline.
    written = pickle.dumps(value, protocol=3)
    written = written.replace(b"cnumpy._core.multiarray\n", b"cnumpy.core.multiarray\n")
    atomic_write(path.parent, {path.name: lambda place: place.write_bytes(written)})


class _RefusedError(Exception):
    """A name that pickles of plain values do not need."""


class _Dtype:
    """Placeholder of a dtype, because the state of a real one could declare pointers in its memory."""

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
    """Placeholder of an array until its state is read."""

    def __init__(self, *_: object) -> None:
        self.value: NDArray[Any] = np.zeros(0)

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        _, shape, dtype, in_columns, raw = state
        self.value = _rebuilt(raw, dtype, shape, "F" if in_columns else "C")


def _rebuilt(raw: bytes | bytearray | str, dtype: object, shape: tuple[int, ...], order: Any) -> NDArray[Any]:
    """Build an array from its bytes, which Python 2 wrote as text."""
    if not isinstance(dtype, _Dtype):
        raise _RefusedError("an array without a dtype")
    data = raw.encode("latin1") if isinstance(raw, str) else bytes(raw)
    return np.frombuffer(data, dtype.dtype).reshape(shape, order=order).copy(order="K")


def _scalar(dtype: object, raw: bytes | str) -> Any:
    return _rebuilt(raw, dtype, (), "C")[()]


def _encode(text: str, encoding: str) -> bytes:
    """Encode text as bytes, as the second protocol does."""
    if encoding != "latin1":
        raise _RefusedError(f"the encoding {encoding!r}")
    return text.encode("latin1")


# What Python's own types may be made of: no number, which would be a size, and nothing that is spelt out as text.
_ARGUMENTS: dict[type, tuple[type, ...]] = {
    **dict.fromkeys((bool, int, float), (bool, int, float, str)),
    str: (str,),
    **dict.fromkeys((bytes, bytearray), (bytes, bytearray, str)),
    **dict.fromkeys((set, frozenset), (list, tuple, set, frozenset)),
}


def _built(kind: type, *kinds: type) -> Callable[..., Any]:
    def build(*arguments: object) -> Any:
        for one in arguments:
            if not isinstance(one, kinds):
                raise _RefusedError(f"{kind.__name__} of {type(one).__name__}")
        return kind(*arguments)

    return build


_ALLOWED: dict[tuple[str, str], object] = {
    ("numpy", "dtype"): _Dtype,
    ("numpy", "ndarray"): _Array,
    ("_codecs", "encode"): _encode,
    **{("numpy.core.multiarray".replace("core", core), "_reconstruct"): _Array for core in ("core", "_core")},
    **{("numpy.core.multiarray".replace("core", core), "scalar"): _scalar for core in ("core", "_core")},
    **{("numpy.core.numeric".replace("core", core), "_frombuffer"): _rebuilt for core in ("core", "_core")},
    **{("builtins", kind.__name__): _built(kind, *kinds) for kind, kinds in _ARGUMENTS.items()},
}


class _Unpickler(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        module = "builtins" if module == "__builtin__" else module
        if (module, name) not in _ALLOWED:
            raise _RefusedError(f"{module}.{name}")
        return _ALLOWED[module, name]

    def persistent_load(self, pid: object) -> Any:
        raise _RefusedError("something outside the file")


class _Plain:
    """Replaces placeholders by arrays, and limits nested lists and dicts."""

    def __init__(self) -> None:
        self.known: dict[int, tuple[Any, int, Any]] = {}  # by identity: the value made, its items, and the original

    def of(self, value: Any, depth: int = 0) -> Any:
        """The value, each part of which is made once, however often it is held.

        Raises:
            _RefusedError: for what is no plain value.
            ValueError: for too many values, or too deep ones.
        """
        if id(value) not in self.known:
            if depth > DEEPEST:
                raise ValueError(f"it holds values more than {DEEPEST} deep")
            made, parts = self._made(value, depth + 1)
            items = 1 + sum(self.known[id(part)][1] for part in parts)
            if items > MOST_ITEMS:
                raise ValueError(f"it holds more than {MOST_ITEMS:,} values")
            self.known[id(value)] = made, items, value
        return self.known[id(value)][0]

    def _made(self, value: Any, depth: int) -> tuple[Any, list[Any]]:
        if isinstance(value, _Array):
            return value.value, []
        if isinstance(value, _Dtype):
            return value.dtype, []
        if isinstance(value, dict):
            made = {self.of(key, depth): self.of(item, depth) for key, item in value.items()}
            return made, [*value.keys(), *value.values()]
        if isinstance(value, (list, tuple, set, frozenset)):
            return type(value)(self.of(item, depth) for item in value), list(value)
        if isinstance(value, (bool, int, float, str, bytes, bytearray, np.ndarray, np.generic, type(None))):
            return value, []
        raise _RefusedError(f"a {type(value).__name__}")
