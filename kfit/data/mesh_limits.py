"""Checks that reject mesh files that declare more than they hold, before time and memory are spent on them."""

from __future__ import annotations

import json
import re
import struct
from pathlib import Path
from typing import Any

import trimesh

from kfit.data.mesh_tree import LARGEST_COMPANION, MOST_MATERIALS

_LARGEST_TEXT = 64 * 1024**2
_USE, _MOST_USES = re.compile(rb"^[ \t]*usemtl([^\n]*)", re.MULTILINE), 100_000
_MOST_FACES, _MOST_NODES = 50_000_000, 5_000
_MOST_TEXELS, _LARGEST_TEXTURE = 400_000_000, 8192


def measure_file(path: Path) -> None:
    """Reject a glTF or OBJ file that declares more than it holds, or so many parts that reading takes minutes."""
    if path.suffix.lower() == ".obj":
        uses = [use.strip() for use in _USE.findall(path.read_bytes())]
        if (kinds := len(set(uses))) > MOST_MATERIALS or len(uses) > _MOST_USES:
            raise ValueError(f"it uses {kinds:,} materials {len(uses):,} times, at most {MOST_MATERIALS:,} are read")
    if path.suffix.lower() not in (".glb", ".gltf"):
        return
    with path.open("rb") as file:
        length = struct.unpack("<12xI4x", file.read(20))[0] if path.suffix.lower() == ".glb" else _LARGEST_TEXT
        content = json.loads(file.read(min(length, path.stat().st_size)))
    nodes, values = len(content.get("nodes", [])), sum(int(one["count"]) for one in content.get("accessors", []))
    parts = sum(len(mesh["primitives"]) for mesh in content.get("meshes", []))
    parts += sum(len(content.get(name, [])) for name in ("materials", "textures", "images"))
    if parts > _MOST_NODES:
        raise ValueError(f"it has {parts:,} primitives, materials and textures, more than {_MOST_NODES:,}")
    if nodes > _MOST_NODES:
        raise ValueError(f"it has {nodes:,} nodes, more than {_MOST_NODES:,}")
    # Those of a .gltf lie in files next to it, each of which is measured when it is read.
    most = path.stat().st_size if path.suffix.lower() == ".glb" else LARGEST_COMPANION
    if values > most:
        raise ValueError(f"its accessors have {values:,} values, more than the file has bytes")


def measure_scene(scene: trimesh.Scene) -> None:
    """Reject a scene that would expand to far more than its file: repeated parts, textures of one colour."""
    parts = [scene.geometry[scene.graph[node][1]] for node in scene.graph.nodes_geometry]
    faces = sum(len(getattr(part, "faces", ())) for part in parts)
    if faces > _MOST_FACES:
        raise ValueError(f"it has {faces:,} faces, more than {_MOST_FACES:,}")
    sizes = [
        image.size for part in parts if (image := material_image(getattr(part.visual, "material", None))) is not None
    ]
    texels = sum(width * height for width, height in sizes)
    if texels > _MOST_TEXELS or any(max(size) > _LARGEST_TEXTURE for size in sizes):
        raise ValueError(
            f"its textures have {texels:,} texels, and at most {_MOST_TEXELS:,} are read, {_LARGEST_TEXTURE} a side"
        )


def material_image(material: object) -> Any:
    """Return the material's texture as a Pillow image; None if it has none."""
    image = getattr(material, "image", None)
    return getattr(material, "baseColorTexture", None) if image is None else image
