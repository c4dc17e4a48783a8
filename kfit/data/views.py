"""The reader of a file of views, as `build_views` and the released code write them."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from kfit.core.arguments import check_arguments
from kfit.data.hdf5 import read_dataset
from kfit.data.view_parts import FIELDS
from kfit.geometry import azimuth_from_released

_log = logging.getLogger(__name__)


class Views:
    """The contents of a file of views, in memory.

    ``images`` (N, H, W, 3) uint8, ``masks`` (N, H, W) uint8, ``elevations`` and ``azimuths`` (N,) float32 in radians,
    ``distances`` (N,) float32 of the camera in box diagonals, ``depth`` (N, H, W) float16 and ``extents``
    (num_objects, 3) float32, these three None where the file has none; ``num_views`` consecutive rows belong to one
    object. Pictures without a fourth channel get as mask what is not white. Reads files of ``build_views`` and the
    released code's own. A file without the attribute ``num_views``, which the released code does not write, is taken
    for one of these: what is transparent in it is white, and azimuths are converted to NOCS's axes by
    `kfit.geometry.azimuth_from_released`.

    Args:
        path: An HDF5 file with ``images`` and ``poses``.
        num_views: Views an object, for files without the attribute of that name.

    Raises:
        FileNotFoundError: If there is no such file.
        ValueError: If the file is not an HDF5 file, is truncated, lacks a dataset or has one of another shape, or its
            number of views is not a multiple of ``num_views``.

    Example:
        >>> from kfit.data import Views, ViewPairs, build_views
        >>> path = build_views("views.h5", "can", num_objects=1, num_views=2, image_size=16)
        >>> views = Views("views.h5")
        >>> views.num_views, views.depth.dtype
        (2, dtype('float16'))
    """

    def __init__(self, path: str | Path, num_views: int | None = None) -> None:
        check_arguments(Views, locals())
        path = Path(path)
        if not path.is_file():
            wrong = "is no regular file" if path.exists() else "does not exist"
            raise FileNotFoundError(f"path must name a file of views, but {path} {wrong}.")
        try:
            with h5py.File(path, "r") as file:
                there = [name for name in FIELDS if file.get(name, getlink=True) is not None]
                data = {name: read_dataset(file, name, path) for name in there}
                stated = file.attrs.get("num_views")
        except (OSError, KeyError, RuntimeError, TypeError) as error:  # TypeError for types that NumPy lacks
            raise ValueError(f"path must name a complete HDF5 file, but {path} cannot be read ({error}).") from error
        for name, ndim in (("images", 4), ("poses", 2)):
            if name not in data or data[name].ndim != ndim:
                found = data[name].shape if name in data else "no such dataset"
                raise ValueError(f"path must hold {name} with {ndim} axes, but {path} has {found}.")
        images, poses = data["images"], data["poses"]
        if images.dtype != np.uint8 or images.shape[3] not in (3, 4):
            raise ValueError(f"images must be (N, H, W, 3 or 4) uint8, but {path} has {images.shape} {images.dtype}.")
        with np.errstate(over="ignore"):  # what is too large for single precision becomes infinite
            poses = poses.astype(np.float32)
        if poses.shape != (len(images), 2) or not np.isfinite(poses).all():
            raise ValueError(f"poses must be ({len(images)}, 2) finite degrees, but {path} has {poses.shape}.")
        views: Any = stated if stated is not None else num_views
        whole = isinstance(views, int | np.integer) and views > 0 and len(images) > 0
        if not whole or len(images) % int(views):
            raise ValueError(f"num_views must divide the {len(images)} rows of {path}, but is {views}.")
        self.num_views = int(views)
        self.num_objects = len(images) // self.num_views
        released = stated is None
        if images.shape[3] == 4 and released:
            images[images[..., 3] == 0, :3] = 255  # white, whatever a released file has left there
        self.images: np.ndarray = images[..., :3]
        self.masks: np.ndarray = (
            images[..., 3] if images.shape[3] == 4 else np.where((images < 250).any(-1), 255, 0).astype(np.uint8)
        )
        self.elevations, self.azimuths = np.deg2rad(poses).T
        if released:
            _log.info("%s is read as the released code's: its azimuths are converted to NOCS's axes.", path)
            self.azimuths = azimuth_from_released(self.azimuths) % np.float32(2 * np.pi)
        expected = {"depth": images.shape[:3], "distances": images.shape[:1], "extents": (self.num_objects, 3)}
        for name, shape in expected.items():
            if name in data and data[name].shape != shape:
                raise ValueError(f"{name} must have shape {shape}, but {path} has {data[name].shape}.")
        self.distances: np.ndarray | None = data.get("distances")
        if self.distances is not None and not (np.isfinite(self.distances) & (self.distances > 0)).all():
            raise ValueError(f"distances must be finite and positive, but {path} has others.")
        self.depth: np.ndarray | None = data.get("depth")
        if self.depth is not None and not all(np.isfinite(row).all() for row in self.depth):
            raise ValueError(f"depth must be finite, 0 outside the object, but {path} has others.")
        self.extents: np.ndarray | None = data.get("extents")
        if self.extents is not None:
            whole = np.isfinite(self.extents) & (self.extents >= 0)  # a flat object has a side of 0
            if not (whole.all() and self.extents.any(1).all()):
                raise ValueError(f"extents must be finite and at least 0, not all 0, but {path} has others.")
