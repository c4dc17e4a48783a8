"""The fitted object's surface as a file."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from kfit.pose import PoseResult

SUFFIXES = (".glb", ".obj", ".ply")


def check_mesh_suffix(path: str) -> None:
    """Refuse names of files that no mesh is written to.

    Raises:
        ValueError: naming the suffixes.
    """
    if Path(path).suffix.lower() not in SUFFIXES:
        raise ValueError(f"mesh must be a .glb, .obj or .ply file, got {path!r}")


def write_mesh(result: PoseResult, path: str | Path, suffix: str | None = None) -> None:
    """Write `PoseResult.mesh`: triangles with vertex colours, metres, y up.

    Args:
        result: result of a fit by a model that draws a volume.
        path: where to.
        suffix: the kind of file, ".glb", ".obj" or ".ply"; by default the path's.

    Raises:
        ValueError: for another kind, and if the object has no surface.
    """
    suffix = (suffix or Path(path).suffix).lower()
    check_mesh_suffix(f"mesh{suffix}")
    mesh = result.mesh()
    if suffix == ".glb":  # its vertex colours are linear light (glTF 2.0, section 3.7.2.1), ours are sRGB
        srgb = mesh.visual.vertex_colors[:, :3] / 255
        linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
        mesh.visual.vertex_colors = (255 * linear).round().astype(np.uint8)
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    mesh.export(path, file_type=suffix[1:])
