"""Files of `torch.save`, read as data whose size is bounded by the file."""

from __future__ import annotations

import mmap
from pathlib import Path
from typing import Any
from zipfile import BadZipFile, ZipFile, is_zipfile

import torch
from torch import Tensor

LARGEST_WEIGHTS = 4 * 1024**3
"""Bytes of the largest file of weights that is read."""


def read_torch(path: str | Path) -> Any:
    """Read a file of tensors in lists and dicts, onto the CPU; nothing in it is run.

    PyTorch's own reader with ``weights_only`` calls no function that a file names but those that rebuild tensors and a
    few of Python's, and trusts the sizes in the file. Here a file is refused that unpacks to more than it
    holds, as none does that PyTorch wrote.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: if it has more than 4 GB, unpacks to more than it holds, is damaged, or holds anything else; in one
            line without the path.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    if (size := path.stat().st_size) > LARGEST_WEIGHTS:
        raise ValueError(f"it has {size:,} bytes, more than {LARGEST_WEIGHTS >> 30} GB")
    try:
        if is_zipfile(path):
            with ZipFile(path) as packed:
                unpacked = sum(part.file_size for part in packed.infolist())
            if unpacked > size:
                raise ValueError(f"it unpacks to {unpacked:,} bytes, more than its own {size:,}")
        # The one name that PyTorch's reader calls with a size out of the file.
        if size and _holds(path, b"bytearray"):
            raise ValueError("it asks for a bytearray, which no weights need")
        value = torch.load(path, map_location="cpu", weights_only=True)
        _check_tensors(value)
    # Whatever PyTorch's unpicklers raise, a full memory among it.
    except Exception as error:
        if isinstance(error, BadZipFile) or not str(error):
            raise ValueError("it is damaged or cut short") from None
        raise ValueError(str(error).splitlines()[0]) from None
    return value


def _holds(path: Path, word: bytes) -> bool:
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as bytes_of:
        return bytes_of.find(word) >= 0


def _check_tensors(value: Any) -> None:
    """Refuse tensors that represent far more numbers than they store; shared storage is checked once."""
    left, met = [value], set()
    while left:
        one = left.pop()
        if id(one) in met:
            continue
        met.add(id(one))
        if isinstance(one, dict):
            left += one.values()
        elif isinstance(one, list | tuple):
            left += one
        elif isinstance(one, Tensor) and (
            one.layout != torch.strided or one.numel() * one.element_size() > LARGEST_WEIGHTS
        ):
            raise ValueError(
                f"it holds a tensor that stands for more than {LARGEST_WEIGHTS >> 30} GB: {tuple(one.shape)}"
            )
