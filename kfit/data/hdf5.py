"""Reading datasets of untrusted HDF5 files."""

from __future__ import annotations

import math
from pathlib import Path

import h5py
import numpy as np

from kfit.runtime.devices import memory

# Bytes that one stored byte may stand for: deflate packs zeros a thousandfold.
MOST_UNPACKED = 1100


def read_dataset(file: h5py.File, name: str, path: Path) -> np.ndarray:
    """Read a dataset of numbers that is stored in the file itself, is complete and fits into memory.

    Args:
        file: open.
        name: name of the dataset.
        path: path of the file, for messages.

    Raises:
        ValueError: for anything else.
    """
    link = file.get(name, getlink=True)
    dataset = file[name] if isinstance(link, h5py.HardLink) else None
    if not isinstance(dataset, h5py.Dataset) or dataset.is_virtual or dataset.external:
        raise ValueError(f"path must hold {name} itself, but {path} has a group or a link to elsewhere.")
    if dataset.shape is None:
        raise ValueError(f"{name} must hold values, but has none in {path}.")
    if dataset.dtype.kind not in "biuf":
        raise ValueError(f"{name} must be numbers, but {path} has {dataset.dtype}.")
    if dataset.nbytes > memory():
        raise ValueError(f"{name} must fit into memory, but takes {dataset.nbytes / 1e9:,.0f} GB in {path}.")
    # What was never written is read as zeros, and what is packed unfolds.
    stored, whole = dataset.id.get_storage_size(), True
    if dataset.chunks is not None:
        sides = zip(dataset.shape, dataset.chunks, strict=True)
        whole = dataset.id.get_num_chunks() == math.prod(-(-side // chunk) for side, chunk in sides)
    if not whole or dataset.nbytes > MOST_UNPACKED * stored:
        raise ValueError(f"{name} must be complete, but {path} holds {stored:,} bytes for {dataset.nbytes:,}.")
    values: np.ndarray = dataset[()]
    return values
