"""Meshes of any kind: each is drawn, or refused in a sentence that names its file."""

from __future__ import annotations

import io
import resource
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh
from PIL import Image

from kfit.data import Light, pose_view
from kfit.data.mesh_files import load_mesh
from kfit.generators import MeshRenderer

CORNERS = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"
PYRAMID = f"{CORNERS}f 1 2 3\nf 1 3 4\nf 1 4 2\nf 2 4 3\n"
TEXTURED = f"mtllib m.mtl\nusemtl a\n{CORNERS}vt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n"
MATERIAL = "newmtl a\nKd 1 1 1\nmap_Kd t.png\n"
EVEN = Light(np.ones(3), np.zeros((0, 3)), np.zeros((0, 3)))
DRAWN = {
    "a triangle": CORNERS + "f 1 2 3\n",
    "a face without area among others": PYRAMID + "f 1 1 2\n",
    "a NaN that no face uses": PYRAMID.replace("v 0 0 1\n", "v 0 0 1\nv nan nan nan\n"),
    "huge": PYRAMID.replace("1", "1e14", 3).replace("f 1e14", "f 1"),
    "small": CORNERS.replace("1", "1e-18") + "f 1 2 3\n",
    "numbers from the end": CORNERS + "f -1 -2 -3\n",
    "a quad": CORNERS + "f 1 2 4 3\n",
    "vertices twice": CORNERS + CORNERS + "f 1 2 3\nf 5 6 7\n",
    "inside out": CORNERS + "f 3 2 1\n",
    "a texture coordinate that is not there": TEXTURED.replace("3/3", "3/9"),
    "a normal that is not there": CORNERS + "f 1//9 2//9 3//9\n",
    "huge texture coordinates": TEXTURED.replace("vt 1 0", "vt 1e20 -1e20"),
    "infinite texture coordinates": TEXTURED.replace("vt 1 0", "vt inf nan"),
    "no material file": TEXTURED.replace("m.mtl", "gone.mtl"),
}
REFUSED = {
    "nothing": "",
    "no faces": CORNERS,
    "lines": CORNERS + "l 1 2\n",
    "points": CORNERS + "p 1 2 3\n",
    "two corners": CORNERS + "f 1 2\n",
    "a line": "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n",
    "a point": "v 1 1 1\nv 1 1 1\nv 1 1 1\nf 1 2 3\n",
    "a corner thrice": CORNERS + "f 1 1 1\n",
    "NaN": "v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
    "infinite": "v inf 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
    "too large for single precision": CORNERS.replace("1", "1e20") + "f 1 2 3\n",
    "too small for single precision": CORNERS.replace("1", "1e-30") + "f 1 2 3\n",
    "too far away for single precision": "v 1e8 1e8 1e8\nv 100000001 1e8 1e8\nv 1e8 100000001 1e8\nf 1 2 3\n",
    "a number beyond": CORNERS + "f 1 2 9\n",
    "a number far beyond": CORNERS + "f 1 2 99999999999999\n",
    "words": CORNERS + "f a b c\n",
    "binary": "\0\1\2",
}
MATERIALS = {
    "garbage": b"\xff\xfe\0garbage",
    "empty": b"",
    "NaN": b"newmtl a\nKd nan nan nan\n",
    "out of range": b"newmtl a\nKd 9 -5 1e30\n",
    "words": b"newmtl a\nKd red\n",
    "a picture that is not there": MATERIAL.encode(),
}


def picture(mode: str, size: tuple[int, int], kind: str = "PNG") -> bytes:
    file = io.BytesIO()
    Image.new(mode, size).save(file, kind)
    return file.getvalue()


PICTURES = {
    "garbage": b"garbage",
    "empty": b"",
    "one pixel": picture("RGB", (1, 1)),
    "16 bits": picture("I;16", (8, 8)),
    "CMYK": picture("CMYK", (8, 8), "JPEG"),
    "palette": picture("P", (8, 8)),
    "alpha": picture("RGBA", (8, 8)),
    "grey": picture("L", (8, 8)),
    "a row": picture("RGB", (5000, 1)),
    "20,000 x 20,000": picture("1", (20_000, 20_000)),
}


def check_drawn(path: Path) -> None:
    """Finite pictures with something in them, by both renderers."""
    mesh = load_mesh(path).normalised()
    view = pose_view(mesh, 0.4, 0.3, EVEN, 16)
    assert view.mask.sum() > 1
    assert all(np.isfinite(part).all() for part in (view.image, view.mask, view.depth, view.coords))
    zero = torch.zeros(1)
    drawn = MeshRenderer(mesh.vertices, mesh.faces, mesh.uv, mesh.texture, num_points=200, image_size=16)(
        azimuth=zero + 0.3, elevation=zero + 0.4, roll=zero, shift=torch.zeros(1, 2), scale=zero + 1
    )
    assert all(bool(part.isfinite().all()) for part in (drawn.image, drawn.mask, drawn.depth))


def check_refused(path: Path) -> None:
    with pytest.raises(ValueError, match="path must hold") as error:
        load_mesh(path)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("text", DRAWN.values(), ids=DRAWN)
def test_odd_meshes_are_drawn(text: str, tmp_path: Path) -> None:
    (tmp_path / "m.obj").write_text(text)
    check_drawn(tmp_path / "m.obj")


@pytest.mark.parametrize("text", REFUSED.values(), ids=REFUSED)
def test_what_is_no_surface_is_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "m.obj").write_text(text)
    check_refused(tmp_path / "m.obj")


@pytest.mark.parametrize("text", MATERIALS.values(), ids=MATERIALS)
def test_odd_materials_are_drawn(text: bytes, tmp_path: Path) -> None:
    (tmp_path / "m.obj").write_text(TEXTURED)
    (tmp_path / "m.mtl").write_bytes(text)
    check_drawn(tmp_path / "m.obj")


@pytest.mark.parametrize("content", PICTURES.values(), ids=PICTURES)
def test_odd_textures_are_drawn(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "m.obj").write_text(TEXTURED)
    (tmp_path / "m.mtl").write_text(MATERIAL)
    (tmp_path / "t.png").write_bytes(content)
    check_drawn(tmp_path / "m.obj")


def test_a_texture_that_is_cut_short_is_refused(tmp_path: Path) -> None:
    (tmp_path / "m.obj").write_text(TEXTURED)
    (tmp_path / "m.mtl").write_text(MATERIAL)
    (tmp_path / "t.png").write_bytes(picture("RGB", (64, 64))[:60])
    check_refused(tmp_path / "m.obj")


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["ply", "glb"])
def test_cut_and_damaged_files_are_drawn_or_refused(kind: str, tmp_path: Path) -> None:
    whole, path, rng = trimesh.creation.box().export(file_type=kind), tmp_path / f"m.{kind}", np.random.default_rng(0)
    for length in (0, 1, 4, 10, 20, 50, len(whole) // 4, len(whole) // 2, len(whole) - 30, len(whole) - 1):
        path.write_bytes(whole[:length])
        check_refused(path)
    refused = 0
    for number in range(40):
        damaged = bytearray(whole)
        for _ in range(1 + number // 8):
            damaged[int(rng.integers(len(damaged) // 2, len(damaged)))] = int(rng.integers(256))
        path.write_bytes(bytes(damaged))
        try:
            load_mesh(path)
        except ValueError:
            check_refused(path)
            refused += 1
    assert 0 < refused <= 40
    trimesh.PointCloud(rng.random((50, 3))).export(path)
    check_refused(path)


def test_triangles_of_vertices_that_are_not_there_are_refused(tmp_path: Path) -> None:
    box = trimesh.creation.box()
    faces = box.faces.copy()
    for number in (8, 1 << 30, -1):
        faces[3, 1] = number
        trimesh.Trimesh(box.vertices, faces, process=False, validate=False).export(tmp_path / "m.ply")
        with pytest.raises(ValueError, match="missing vertices"):
            load_mesh(tmp_path / "m.ply")


@pytest.mark.slow
def test_a_million_triangles_and_a_large_texture_take_bounded_memory(tmp_path: Path) -> None:
    trimesh.creation.icosphere(8).export(tmp_path / "ball.ply")  # 1.3 million
    (tmp_path / "m.obj").write_text(TEXTURED)
    (tmp_path / "m.mtl").write_text(MATERIAL)
    (tmp_path / "t.png").write_bytes(picture("1", (8000, 8000)))
    for name in ("m.obj", "ball.ply"):
        check_drawn(tmp_path / name)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    assert peak < 4  # GB, PyTorch and all
