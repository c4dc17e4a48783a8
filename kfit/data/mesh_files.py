"""Meshes from disk: OBJ, glTF, PLY and STL with their colours, and folders in ShapeNet's layout."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
import trimesh
from PIL import EpsImagePlugin

from kfit.data.mesh import Mesh, join
from kfit.data.mesh_limits import material_image, measure_file, measure_scene
from kfit.data.mesh_tree import MeshTree
from kfit.runtime.ignored_warnings import ignore_warnings

_log = logging.getLogger(__name__)
_SUFFIXES = (".obj", ".glb", ".gltf", ".ply", ".stl")
_SPELLED = "OBJ, GLB, glTF, PLY or STL"
# Meshes and scenes of programs, which are not read, but not passed over in silence either.
_OTHERS = (
    *(".3ds", ".3mf", ".abc", ".amf", ".blend", ".c4d", ".dae", ".fbx", ".lwo", ".ma", ".max", ".off", ".ply2"),
    *(".skp", ".step", ".stp", ".usd", ".usda", ".usdc", ".usdz", ".vrml", ".wrl", ".x3d"),
)
_SHOWN = 5
_MAX_TEXTURE = 1024
_LARGEST_FILE = 2 * 1024**3
# Squares of coordinates up to here are finite in single precision.
_FARTHEST = 1e15


def find_meshes(folder: str | Path) -> list[Path]:
    """Find the mesh files in a folder, one for each object, sorted.

    An object's own folder ``<id>`` may hold ``model.obj`` (NOCS) or ``models/model_normalized.obj`` (ShapeNetCore v2);
    these come first, and where a folder has neither, any OBJ, GLB, glTF, PLY or STL file in it counts. The log lists
    files that look like meshes and are left out.

    Raises:
        FileNotFoundError: If there is no such folder.
        ValueError: If it holds no mesh.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise FileNotFoundError(f"folder must be an existing folder of meshes, but {folder} is none.")
    found = meshes_of(folder)
    others = (file for file in folder.rglob("*") if file.suffix.lower() in (*_SUFFIXES, *_OTHERS))
    if skipped := [str(file.relative_to(folder)) for file in sorted(set(others) - set(found))]:
        more = f" and {len(skipped) - _SHOWN} more" if len(skipped) > _SHOWN else ""
        _log.warning("%s: not read: %s%s", folder, ", ".join(skipped[:_SHOWN]), more)
    if not found:
        raise ValueError(f"folder must hold {_SPELLED} files, but {folder} holds none.")
    return found


def meshes_of(folder: Path) -> list[Path]:
    """Return the mesh files that `find_meshes` finds, which may be none, and log nothing."""
    of_layout = sorted({*folder.rglob("model.obj"), *folder.rglob("models/model_normalized.obj")})
    files = (file for file in folder.rglob("*") if file.suffix.lower() in _SUFFIXES and file.is_file())
    return of_layout or sorted(files)


def load_mesh(path: str | Path) -> Mesh:
    """Read a mesh with its colours, in its own frame and unit.

    Each material becomes a tile of one atlas: its texture (at most 1024 pixels a side) times its colour, its plain
    colour, or the vertices' colours. Textures are read from the mesh's own folder and those below it, and in the layout
    of ShapeNetCore.v2 from ``../images``; the log names what is not read. NOCS's own object models are already in
    NOCS's frame (their coordinates agree with the coordinate maps axis by axis); other meshes may need
    ``Mesh.transformed`` to bring y up and their front to +x.

    Raises:
        FileNotFoundError: If there is no such file.
        ValueError: If the file's name ends otherwise, it cannot be read, or it holds no triangles with an area.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"path must name a mesh file, but {path} does not exist.")
    if path.suffix.lower() not in _SUFFIXES:
        raise ValueError(f"path must end in {', '.join(_SUFFIXES)}, but is {path}.")
    if path.stat().st_size > _LARGEST_FILE:
        raise ValueError(f"path must name a file of at most 2 GB, but {path} has {path.stat().st_size:,} bytes.")
    try:
        # Scans may hold undefined texture coordinates, of which numpy warns while they are read.
        with np.errstate(all="ignore"), ignore_warnings(), _without_ghostscript():
            measure_file(path)
            tree = MeshTree(path)
            scene = trimesh.load_scene(path, resolver=tree, process=False)
            if tree.too_large is not None:
                raise ValueError(tree.too_large)
            measure_scene(scene)
            geometries = [g for g in scene.dump() if isinstance(g, trimesh.Trimesh) and len(g.faces)]
    except Exception as error:  # trimesh raises whatever its many parsers raise
        raise ValueError(f"path must hold a readable mesh, but {path} does not ({error}).") from error
    if not geometries:
        raise ValueError(f"path must hold triangles, but {path} has none.")
    if tree.dropped:
        _log.warning("%s is read without %s", path, "; ".join(dict.fromkeys(tree.dropped)))
    largest = max(float(np.abs(geometry.vertices).max()) for geometry in geometries)
    if not largest < _FARTHEST:
        raise ValueError(f"path must hold finite vertices, but {path} has one at {largest:g}.")
    for geometry in geometries:
        if not 0 <= int(geometry.faces.min()) <= int(geometry.faces.max()) < len(geometry.vertices):
            raise ValueError(f"path must hold triangles, but those of {path} have missing vertices.")
    try:
        with _without_ghostscript():
            mesh = join([_part(geometry) for geometry in geometries])
    except (OSError, SyntaxError) as error:
        raise ValueError(f"path must hold a readable mesh, but a picture of {path} is not ({error}).") from error
    corners = mesh.vertices[mesh.faces]
    if not np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).any():
        raise ValueError(f"path must hold triangles with an area, but {path} has none.")
    return mesh


@contextmanager
def _without_ghostscript() -> Iterator[None]:
    """Disable PostScript, which Pillow recognises under any file name and passes to Ghostscript."""
    before, EpsImagePlugin.gs_binary = EpsImagePlugin.gs_binary, False
    try:
        yield
    finally:
        EpsImagePlugin.gs_binary = before


def _part(geometry: trimesh.Trimesh) -> Mesh:
    """One geometry with one material as a part."""
    vertices = np.asarray(geometry.vertices, np.float32)
    faces = np.asarray(geometry.faces, np.int32)
    normals = _smooth_normals(vertices, np.asarray(geometry.vertex_normals, np.float64))
    visual = geometry.visual
    if isinstance(visual, trimesh.visual.TextureVisuals):
        texture = _material_texture(visual.material)
        uv = np.full((len(vertices), 2), 0.5) if visual.uv is None else np.nan_to_num(np.asarray(visual.uv, np.float64))
        vertices, faces, normals, place, texture = _wrapped(vertices, faces, normals, uv, texture)
        return Mesh(vertices, faces, normals, place, texture)
    colors = np.asarray(visual.vertex_colors)[:, :3].astype(np.uint8)
    if not visual.defined:
        colors = np.full_like(colors, 180)
    # A texel a vertex: the rasterizer interpolates coordinates, so neighbours' colours lie next to each other only by
    # luck; faces therefore take the mean colour of their corners, each with a texel of its own.
    mean = colors[faces].astype(np.float32).mean(axis=1).round().astype(np.uint8)
    side = int(np.ceil(np.sqrt(len(faces))))
    texture = np.zeros((side * side, 3), np.uint8)
    texture[: len(faces)] = mean
    index = np.arange(len(faces))
    place = (np.stack([index % side, index // side], axis=1) + 0.5) / side
    corners = faces.ravel()
    return Mesh(
        vertices[corners],
        np.arange(len(corners), dtype=np.int32).reshape(-1, 3),
        normals[corners],
        np.repeat(place, 3, axis=0).astype(np.float32),
        texture.reshape(side, side, 3),
    )


def _smooth_normals(vertices: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Average normals over vertices at one place, which files split at texture seams, except across sharp edges."""
    _, group = np.unique(vertices, axis=0, return_inverse=True)
    total = np.stack([np.bincount(group.ravel(), weights=normals[:, k]) for k in range(3)], axis=1)
    mean = total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-12)
    mean = mean[group.ravel()]
    own = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    smooth: np.ndarray = np.where((own * mean).sum(axis=1, keepdims=True) > 0.75, mean, own)
    return smooth.astype(np.float32)


def _wrapped(
    vertices: np.ndarray, faces: np.ndarray, normals: np.ndarray, uv: np.ndarray, texture: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Bring repeating texture coordinates into [0, 1] and turn their rows downwards.

    A face's coordinates are shifted by whole repeats; where they still span more than one, the texture is tiled, up to
    four times a side, and what spans more is squeezed.
    """
    if uv.min() >= -1e-4 and uv.max() <= 1 + 1e-4:
        place = np.stack([uv[:, 0], 1 - uv[:, 1]], axis=1).clip(0, 1)
        return vertices, faces, normals, place.astype(np.float32), texture
    corners = faces.ravel()
    per_face = uv[corners].reshape(-1, 3, 2)
    per_face = per_face - np.floor(per_face.min(axis=1, keepdims=True) + 1e-6)
    repeats = np.clip(np.ceil(per_face.max(axis=(0, 1)) - 1e-4), 1, 4).astype(int)
    per_face = np.minimum(per_face, repeats) / repeats
    tiled = np.tile(texture, (repeats[1], repeats[0], 1))
    largest = max(tiled.shape[:2])
    if largest > _MAX_TEXTURE:
        tiled = _shrunk(tiled)
    place = per_face.reshape(-1, 2)
    place[:, 1] = 1 - place[:, 1]
    new_faces = np.arange(len(corners), dtype=np.int32).reshape(-1, 3)
    return vertices[corners], new_faces, normals[corners], place.clip(0, 1).astype(np.float32), tiled


def _material_texture(material: object) -> np.ndarray:
    """The material's picture times its colour, or a tile of its colour."""
    image = material_image(material)
    color = getattr(material, "baseColorFactor", None)
    if color is None and image is None:
        color = getattr(material, "diffuse", None)
    tint = np.ones(3) if color is None else np.asarray(color, np.float64)[:3]
    if tint.max() > 1:
        tint = tint / 255
    if image is None:
        return np.broadcast_to((tint * 255 + 0.5).astype(np.uint8), (4, 4, 3)).copy()
    return (_shrunk(np.asarray(image.convert("RGB"), np.uint8)) * tint).astype(np.uint8)


def _shrunk(picture: np.ndarray) -> np.ndarray:
    """Reduce a picture to at most 1024 pixels a side, by area means."""
    largest = max(picture.shape[:2])
    if largest <= _MAX_TEXTURE:
        return picture
    size = [max(1, round(side * _MAX_TEXTURE / largest)) for side in picture.shape[1::-1]]
    smaller: np.ndarray = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    return smaller
