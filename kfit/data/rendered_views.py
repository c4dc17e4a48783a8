"""Rendering of views of many objects to one HDF5 file, in the layout of the released training data."""

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

from kfit.core.arguments import check_arguments
from kfit.core.check import check_choice, check_list, check_rising
from kfit.data import shapes
from kfit.data.drawn_objects import DrawnObjects, in_order
from kfit.data.mesh_places import MeshFile, as_mesh_file, check_mesh_file, source_identity
from kfit.data.view_parts import ViewParts
from kfit.geometry import UNIT_FRACTION, Category
from kfit.runtime.atomic_write import atomic_write

_log = logging.getLogger(__name__)


def build_views(
    path: str | Path,
    source: str | Category | Sequence[str | Path | MeshFile],
    num_objects: int,
    num_views: int,
    image_size: int = 64,
    seed: int = 0,
    held_out: bool = False,
    elevation_deg: tuple[float, float] = (-15.0, 75.0),
    upright: float = 0.5,
    distance: tuple[float, float] = (1.3, 8.0),
    unit_fraction: float = UNIT_FRACTION,
    supersample: int = 2,
) -> Path:
    """Render ``num_objects`` × ``num_views`` pictures to one HDF5 file.

    With N = num_objects · num_views rows, ``num_views`` consecutive ones an object: ``images`` (N, H, W, 4) uint8 RGB
    on white and mask, ``poses`` (N, 2) float32 elevation and azimuth in degrees, ``depth`` (N, H, W) float16 in box
    diagonals relative to the object's centre, positive away from the camera and 0 outside; ``distances`` (N,) float32
    from the camera to the object's centre in box diagonals; ``extents`` (num_objects, 3) box sides over the box
    diagonal. Azimuths are uniform on the full circle. A share ``upright`` of the elevations is uniform in
    ``elevation_deg``; the others see the object from directions that are uniform on the sphere: elevation =
    arcsin(uniform(−1, 1)). Roll is 0. Distances are log-uniform, and at each the camera of
    ``kfit.data.rasterizer.standard_intrinsics`` frames the object. An object's numbers depend on ``seed`` and its own
    index alone.

    A complete file with the same settings is reused, one with others is replaced, which is logged. An interrupted build
    is resumed, and processes that build the same file at once produce one complete file.

    Args:
        path: The file to write.
        source: A category of ``kfit.data.shapes``, one of your own, or mesh files; object i is drawn from file i
            modulo their number.
        num_objects: Objects to draw.
        num_views: Views of each.
        image_size: Side of the pictures in pixels.
        seed: Chooses objects, lights and poses.
        held_out: Take the shape and texture families that training never sees; without meaning for mesh files.
        elevation_deg: Range of the elevations of upright objects.
        upright: Share of the views that show upright objects, in [0, 1].
        distance: Range of the camera's distance from the object's centre, in box diagonals; equal ends fix it.
        unit_fraction: Share of the picture's width that the sphere of unit diameter spans.
        supersample: Samples a pixel along each side.

    Raises:
        ValueError: If a number is not positive, the range is reversed, or the category unknown.
        FileNotFoundError: If a mesh file is missing.

    Example:
        >>> from kfit.data import Views, ViewPairs, build_views
        >>> path = build_views("views.h5", "can", num_objects=1, num_views=2, image_size=16)
        >>> Views("views.h5").images.shape
        (2, 16, 16, 3)
    """
    check_arguments(
        build_views,
        locals(),
        seed=(0,),
        elevation_deg=(check_rising, -90, 90),
        upright=(0, 1),
        distance=(check_rising, 1, 1e6),
        unit_fraction=(0.1, 10),
        supersample=(1, 16),
    )
    if isinstance(source, str):
        check_choice("source", source, shapes.CATEGORIES)
    elif not isinstance(source, Category):
        check_list("source", source, None, check_mesh_file)
    drawn = source if isinstance(source, str | Category) else [as_mesh_file(file) for file in source]
    settings: dict[str, Any] = {
        "source": source_identity(drawn),
        "shapes_version": shapes.version_of(source) if isinstance(source, Category) else shapes.VERSION,
        "num_objects": num_objects,
        "num_views": num_views,
        "image_size": image_size,
        "seed": seed,
        "held_out": held_out,
        "elevation_deg": [float(e) for e in elevation_deg],
        "upright": float(upright),
        "distance": [float(d) for d in distance],
        "unit_fraction": unit_fraction,
        "supersample": supersample,
    }
    path = Path(path)
    if _finished(path, settings):
        return path
    if path.exists():
        _log.warning("%s was built with other settings and is built anew.", path)
    parts = ViewParts(path.with_name(path.name + ".partial"), settings)
    while not _finished(path, settings):
        _draw(parts, drawn)
        try:
            atomic_write(path.parent, {path.name: lambda place: _join(place, parts)})
        except FileNotFoundError:  # another process was done first and has removed the parts, or one was damaged
            continue
    parts.remove()
    return path


def _finished(path: Path, settings: dict[str, Any]) -> bool:
    return path.is_file() and settings_of(path) == settings


def _draw(parts: ViewParts, source: str | Category | Sequence[MeshFile]) -> None:
    """Draw the parts that are missing."""
    missing, total = parts.missing(), int(parts.settings["num_objects"])
    indices = [index for part in missing for index in parts.objects(part)]
    console = Console(stderr=True, quiet=not (sys.stderr.isatty() and _log.isEnabledFor(logging.WARNING)))
    title = f"Rendering {parts.settings['source'] if isinstance(source, str | Category) else f'{len(source)} meshes'}"
    drawn = in_order(DrawnObjects(parts.settings, source, indices))
    tracked = iter(track(drawn, title, console=console, total=total, completed=total - len(indices)))
    for part in missing:
        parts.write(part, [next(tracked) for _ in parts.objects(part)])


def _join(path: Path, parts: ViewParts) -> None:
    """Write the file with one chunk for each object, so that reading one object reads one chunk."""
    settings = parts.settings
    objects, views, size = (int(settings[name]) for name in ("num_objects", "num_views", "image_size"))
    num = objects * views
    # In memory, from where Python writes it: on a full disk HDF5 drops what it cannot write, and goes on.
    with h5py.File(path.name, "w", driver="core", backing_store=False) as file:
        file.create_dataset("images", (num, size, size, 4), np.uint8, chunks=(views, size, size, 4), compression="lzf")
        file.create_dataset("depth", (num, size, size), np.float16, chunks=(views, size, size), compression="lzf")
        file.create_dataset("poses", (num, 2), np.float32)
        file.create_dataset("distances", (num,), np.float32)
        file.create_dataset("extents", (objects, 3), np.float32)
        for part, arrays in parts.read():
            rows = slice(part.start * views, part.stop * views)
            for name in ("images", "depth", "poses", "distances"):
                file[name][rows] = arrays[name].reshape(-1, *arrays[name].shape[2:])
            file["extents"][part.start : part.stop] = arrays["extents"]
        file.attrs["settings"] = json.dumps(settings)
        file.attrs["num_views"] = views
        file.attrs["num_done"] = objects
        file.flush()
        path.write_bytes(file.id.get_file_image())


def settings_of(path: Path) -> dict[str, object] | None:
    """Return the settings of a file, or None if it is not such a file or damaged."""
    try:
        with h5py.File(path, "r") as file:
            settings: dict[str, object] = json.loads(file.attrs["settings"])
            return settings
    except (OSError, KeyError, ValueError, TypeError):
        return None
