"""What a visitor may take home of an answer."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from kfit.pose import PoseResult
from kfit.reports.fitted_photo import fitted_photo
from kfit.reports.mesh_file import write_mesh
from kfit.runtime.atomic_write import atomic_write

# Files, and what their buttons say.
FILES = {
    "report.html": "Report",
    "pose.json": "Numbers (JSON)",
    "overlay.png": "Picture",
    "mesh.glb": "Mesh (GLB)",
    "mask.png": "Mask",
    "repeat.py": "Python that repeats it",
}


def write_downloads(folder: Path, result: PoseResult, command: str, snippet: str) -> dict[str, Path]:
    """Write all of `FILES`, or none, but for the mesh of an answer without a surface; paths by name."""
    from kfit import report

    writers: dict[str, Callable[[Path], object]] = {
        "report.html": lambda path: report(result, path, command=command),
        "pose.json": lambda path: path.write_text(json.dumps(result.to_dict(), indent=2) + "\n"),
        "overlay.png": lambda path: Image.fromarray(fitted_photo(result)).save(path, "PNG"),
        "mesh.glb": lambda path: write_mesh(result, path, ".glb"),
        "mask.png": lambda path: _mask_picture(result.mask).save(path, "PNG"),
        "repeat.py": lambda path: path.write_text(snippet, encoding="utf-8"),
    }
    if not _has_surface(result):
        del writers["mesh.glb"]
    return dict(zip(writers, atomic_write(folder, writers), strict=True))


def snippet_of(photo: str, model: str, camera: tuple[float, float, float, float] | None, depth: str | None) -> str:
    """Write a Python program that repeats an answer, with the photo and the downloaded mask in its folder.

    Args:
        photo: name of the photo.
        model: category of a bundled model, or path of another model's file.
        camera: fx, fy, cx and cy in pixels.
        depth: name of the depth map.
    """
    lines = [f"image = read_photo({photo!r})"]
    words = ["mask=imread('mask.png')"]
    if camera is not None:
        lines.append("fx, fy, cx, cy = {:g}, {:g}, {:g}, {:g}".format(*camera))
        words.append("intrinsics=np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])")
    if depth is not None:
        words.append(f"depth=depth_from_file({depth!r}, image.image.shape[:2])")
    names = ["read_photo"] if depth is None else ["depth_from_file", "read_photo"]
    imports = ["import numpy as np"] if camera is not None else []
    return "\n".join(
        [
            f'"""Repeats an answer of kfit\'s app; {photo} and mask.png lie in the working folder."""',
            "",
            *imports,
            "from skimage.io import imread",
            "",
            "import kfit",
            f"from kfit.segmentation import {', '.join(names)}",
            "",
            *lines,
            f"[result] = kfit.find_poses(image, kfit.load({model!r}), {', '.join(words)})",
            "print(result.rotation, result.translation, result.size, result.confidence)",
            'kfit.report(result, "report.html")',
            "",
        ]
    )


def _mask_picture(mask: NDArray[np.float32]) -> Image.Image:
    return Image.fromarray(255 * (np.asarray(mask) > 0.5).astype(np.uint8))


def _has_surface(result: PoseResult) -> bool:
    try:
        return result.surface is not None and len(result.surface().faces) > 0
    except ValueError:  # the fitted volume is empty
        return False
