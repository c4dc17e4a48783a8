"""Views of many objects in one HDF5 file, in the layout of the released training data, and their reader."""

from __future__ import annotations

import json
import logging
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from rich.console import Console
from rich.progress import track

from kfit.data import shapes
from kfit.data.drawn_objects import DrawnObjects, in_order
from kfit.data.rasterizer import DISTANCE
from kfit.geometry import UNIT_FRACTION

_log = logging.getLogger(__name__)


def build_views(
    path: str | Path,
    source: str | Sequence[str | Path],
    num_objects: int,
    num_views: int,
    image_size: int = 64,
    seed: int = 0,
    held_out: bool = False,
    elevation_deg: tuple[float, float] = (-15.0, 75.0),
    distance: float = DISTANCE,
    unit_fraction: float = UNIT_FRACTION,
    supersample: int = 2,
) -> Path:
    """Render ``num_objects`` × ``num_views`` pictures into one HDF5 file.

    With N = num_objects · num_views rows, ``num_views`` consecutive ones an object: ``images`` (N, H, W, 4) uint8 RGB
    on white and mask, ``poses`` (N, 2) float32 elevation and azimuth in degrees, ``depth`` (N, H, W) float16 in box
    diagonals relative to the object's centre, positive away from the camera and 0 outside; ``extents`` (num_objects, 3)
    box sides over the box diagonal. Azimuths are uniform on the full circle, elevations in their range, roll is 0. An
    object's numbers depend on ``seed`` and its own index alone.

    A finished file with the same settings is used as it is, one with others is replaced with a word in the log. An
    interrupted build goes on from the last finished object.

    Args:
        path: The file to write.
        source: A category of ``kfit.data.shapes`` or mesh files; object i is drawn from file i modulo their number.
        num_objects: Objects to draw.
        num_views: Views of each.
        image_size: Side of the pictures in pixels.
        seed: Chooses objects, lights and poses.
        held_out: Take the shape and texture families that training never sees; without meaning for mesh files.
        elevation_deg: Range of elevations.
        distance: Of the camera from the object's centre, in box diagonals.
        unit_fraction: Share of the picture's width that a unit diagonal at the centre spans.
        supersample: Samples a pixel along each side.

    Raises:
        ValueError: If a number is not positive, the range is reversed, or the category unknown.
        FileNotFoundError: If a mesh file is missing.
    """
    for name, value in {"num_objects": num_objects, "num_views": num_views, "image_size": image_size}.items():
        if value < 1:
            raise ValueError(f"{name} must be at least 1, but is {value}.")
    if elevation_deg[0] > elevation_deg[1]:
        raise ValueError(f"elevation_deg must run from low to high, but is {tuple(elevation_deg)}.")
    settings: dict[str, Any] = {
        "source": source if isinstance(source, str) else [f"{Path(f).name} {Path(f).stat().st_size}" for f in source],
        "shapes_version": shapes.VERSION,
        "num_objects": num_objects,
        "num_views": num_views,
        "image_size": image_size,
        "seed": seed,
        "held_out": held_out,
        "elevation_deg": [float(e) for e in elevation_deg],
        "distance": distance,
        "unit_fraction": unit_fraction,
        "supersample": supersample,
    }
    path = Path(path)
    if path.exists():
        if _settings_of(path) == settings:
            return path
        _log.warning("%s was built with other settings and is built anew.", path)
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(path.name + ".partial")
    if partial.exists() and _settings_of(partial) != settings:
        partial.unlink()
    with h5py.File(partial, "a") as file:
        if "images" not in file:
            _create(file, settings, num_objects, num_views, image_size)
        done = int(file.attrs["num_done"])
        objects = DrawnObjects(settings, source, range(done, num_objects))
        console = Console(stderr=True, quiet=not (sys.stderr.isatty() and _log.isEnabledFor(logging.WARNING)))
        title = f"Rendering {source if isinstance(source, str) else f'{len(source)} meshes'}"
        drawn = track(in_order(objects), title, console=console, total=num_objects, completed=done)
        for index, (rgba, depth, poses, extents) in enumerate(drawn, done):
            rows = slice(index * num_views, (index + 1) * num_views)
            file["images"][rows], file["depth"][rows], file["poses"][rows] = rgba, depth, poses
            file["extents"][index] = extents
            file.flush()
            file.attrs["num_done"] = index + 1
    partial.replace(path)
    return path


def _create(file: h5py.File, settings: dict[str, Any], num_objects: int, num_views: int, size: int) -> None:
    """Lay out the datasets: a chunk an object, so that reading one object reads one chunk."""
    num = num_objects * num_views
    file.create_dataset("images", (num, size, size, 4), np.uint8, chunks=(num_views, size, size, 4), compression="lzf")
    file.create_dataset("depth", (num, size, size), np.float16, chunks=(num_views, size, size), compression="lzf")
    file.create_dataset("poses", (num, 2), np.float32)
    file.create_dataset("extents", (num_objects, 3), np.float32)
    file.attrs["settings"] = json.dumps(settings)
    file.attrs["num_views"] = settings["num_views"]
    file.attrs["num_done"] = 0


def _settings_of(path: Path) -> dict[str, object] | None:
    """Settings a file was built with, None where it is no such file or broken."""
    try:
        with h5py.File(path, "r") as file:
            settings: dict[str, object] = json.loads(file.attrs["settings"])
            return settings
    except (OSError, KeyError, ValueError):
        return None


class Views:
    """The contents of a file of views, in memory.

    ``images`` (N, H, W, 3) uint8, ``masks`` (N, H, W) uint8, ``elevations`` and ``azimuths`` (N,) float32 in radians,
    ``depth`` (N, H, W) float16 and ``extents`` (num_objects, 3) float32, both None where the file has none;
    ``num_views`` consecutive rows belong to one object. Pictures without a fourth channel get as mask what is not
    white. Reads files of ``build_views`` and the released code's own.

    Args:
        path: An HDF5 file with ``images`` and ``poses``.
        num_views: Views an object, for files that do not say it themselves.

    Raises:
        FileNotFoundError: If there is no such file.
        ValueError: If the file is no HDF5 file, is cut short, lacks a dataset or has one of another shape, or does not
            divide into objects of ``num_views``.
    """

    def __init__(self, path: str | Path, num_views: int | None = None) -> None:
        path = Path(path)
        if not path.exists():
            raise FileNotFoundError(f"path must name a file of views, but {path} does not exist.")
        try:
            with h5py.File(path, "r") as file:
                data = {name: file[name][()] for name in ("images", "poses", "depth", "extents") if name in file}
                stated = file.attrs.get("num_views")
                ours = "num_done" in file.attrs
                unfinished = ours and file.attrs["num_done"] != json.loads(file.attrs["settings"])["num_objects"]
        except OSError as error:
            raise ValueError(f"path must name a whole HDF5 file, but {path} cannot be read ({error}).") from error
        for name, ndim in (("images", 4), ("poses", 2)):
            if name not in data or data[name].ndim != ndim:
                found = data[name].shape if name in data else "no such dataset"
                raise ValueError(f"path must hold {name} with {ndim} axes, but {path} has {found}.")
        images, poses = data["images"], data["poses"]
        if images.dtype != np.uint8 or images.shape[3] not in (3, 4):
            raise ValueError(f"images must be (N, H, W, 3 or 4) uint8, but {path} has {images.shape} {images.dtype}.")
        if poses.shape != (len(images), 2):
            raise ValueError(f"poses must be ({len(images)}, 2), but {path} has {poses.shape}.")
        if unfinished:
            raise ValueError(f"path must name a finished file of views, but the build of {path} was interrupted.")
        views = stated if stated is not None else num_views
        if views is None or len(images) == 0 or len(images) % int(views):
            raise ValueError(f"num_views must divide the {len(images)} rows of {path}, but is {views}.")
        self.num_views = int(views)
        self.num_objects = len(images) // self.num_views
        if images.shape[3] == 4 and not ours:
            images[images[..., 3] == 0, :3] = 255  # white, whatever a released file has left there
        self.images: np.ndarray = images[..., :3]
        self.masks: np.ndarray = (
            images[..., 3] if images.shape[3] == 4 else np.where((images < 250).any(-1), 255, 0).astype(np.uint8)
        )
        self.elevations, self.azimuths = np.deg2rad(poses.astype(np.float32)).T
        self.depth: np.ndarray | None = data.get("depth")
        self.extents: np.ndarray | None = data.get("extents")
