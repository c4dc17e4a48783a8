"""Views of many objects, drawn by all cores."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from torch.utils.data import DataLoader, Dataset

from kfit.data import shapes
from kfit.data.exposure import with_exposure
from kfit.data.light import Light
from kfit.data.mesh import Mesh
from kfit.data.mesh_places import MeshFile
from kfit.data.rasterizer import pose_view
from kfit.geometry import Category
from kfit.runtime.devices import cores, on_one_core

# Objects of one seed are numbered from seed · this, so different seeds share no object.
SEED_STRIDE = 1 << 24
# Pictures to draw from which on other processes help: they take a second or two to start.
_MANY = 1000


class DrawnObjects(Dataset[tuple[np.ndarray, ...] | Exception]):
    """Views of each object, as `kfit.data.build_views` draws and keeps them.

    Each is RGB and mask (V, S, S, 4) uint8, depth (V, S, S) relative to the object's centre, elevations and azimuths
    (V, 2) in degrees, distances (V,) in box diagonals, and extents (3,). The error takes the place of an object whose
    file cannot be read.

    Args:
        settings: settings of the build.
        source: a category, or mesh files.
        indices: which objects.
    """

    def __init__(
        self, settings: dict[str, Any], source: str | Category | Sequence[MeshFile], indices: Sequence[int]
    ) -> None:
        self.settings, self.source, self.indices = settings, source, indices

    def __len__(self) -> int:
        return len(self.indices)

    def __getitem__(self, number: int) -> tuple[np.ndarray, ...] | Exception:
        try:
            return self._drawn(number)
        except (OSError, ValueError) as error:  # raised in another process, it would bring PyTorch's traceback along
            return error

    def _drawn(self, number: int) -> tuple[np.ndarray, ...]:
        index, settings = self.indices[number], self.settings
        seed, held_out, count = (settings[name] for name in ("seed", "held_out", "num_views"))
        size, unit_fraction, supersample = (settings[name] for name in ("image_size", "unit_fraction", "supersample"))
        mesh, light = _object(self.source, seed, index, held_out)
        rng = np.random.default_rng([seed, index, int(held_out), 1])
        upright = rng.random(count) < settings["upright"]
        on_sphere = np.rad2deg(np.arcsin(rng.uniform(-1, 1, count)))
        (low, high), (nearest, farthest) = settings["elevation_deg"], settings["distance"]
        elevations = np.where(upright, rng.uniform(low, high, count), on_sphere)
        azimuths = rng.uniform(0, 360, count)
        distances = np.exp(rng.uniform(np.log(nearest), np.log(farthest), count)).astype(np.float32)
        rgba, depth = [], []
        for elevation, azimuth, distance in zip(np.deg2rad(elevations), np.deg2rad(azimuths), distances, strict=True):
            view = pose_view(mesh, elevation, azimuth, light, size, float(distance), unit_fraction, supersample)
            rgba.append(np.concatenate([view.image, view.mask[..., None]], axis=2))
            depth.append(np.where(view.mask > 0, view.depth - distance, 0))
        images = (np.stack(rgba) * 255 + 0.5).astype(np.uint8)
        return images, np.stack(depth), np.stack([elevations, azimuths], axis=1), distances, mesh.extents


def in_order(objects: DrawnObjects) -> Iterator[tuple[np.ndarray, ...]]:
    """Yield the objects in order, drawn by several processes if there are many objects and cores.

    Raises:
        OSError, ValueError: if a mesh file cannot be read.
    """
    many = cores() > 1 and len(objects) * objects.settings["num_views"] >= _MANY
    # They draw and nothing else, so that PyTorch's threads, of which Python warns, do not matter to them.
    warnings.filterwarnings("ignore", message=".*use of fork\\(\\) may lead to deadlocks.*")
    workers = cores() if many else 0
    for drawn in DataLoader(
        objects, batch_size=None, num_workers=workers, collate_fn=_unchanged, worker_init_fn=on_one_core
    ):
        if isinstance(drawn, Exception):
            raise drawn
        yield drawn


def _unchanged(drawn: Any) -> Any:
    return drawn


def _object(source: str | Category | Sequence[MeshFile], seed: int, index: int, held_out: bool) -> tuple[Mesh, Light]:
    if isinstance(source, str | Category):
        return shapes.build(source, seed * SEED_STRIDE + index, held_out)
    light = Light.random(np.random.default_rng([seed, index, int(held_out), 2]))
    file = source[index % len(source)]
    return _from_file(file, file.path.stat().st_mtime_ns), light


@lru_cache(maxsize=16)
def _from_file(file: MeshFile, changed: int) -> Mesh:
    """Return a mesh ready to draw; files that are drawn often are cached until they change."""
    return with_exposure(file.mesh(), two_sided=None)
