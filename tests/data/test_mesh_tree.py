"""What belongs to a mesh: its own tree is read, nothing outside it, and the tree's contents tell meshes apart."""

from __future__ import annotations

import json
import logging
import os
import struct
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from kfit.data.mesh_files import load_mesh
from kfit.data.mesh_tree import mesh_identities
from kfit.data.rendered_views import build_views
from kfit.data.views import Views

MESH = "mtllib m.mtl\nusemtl a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n"


def model(folder: Path, picture: str, color: tuple[int, int, int] = (255, 0, 0), name: str = "m.obj") -> Path:
    """A red triangle whose texture lies at ``picture``, seen from the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text(MESH)
    (folder / "m.mtl").write_text(f"newmtl a\nKd 1 1 1\nmap_Kd {picture}\n")
    place = folder / picture.replace("\\", "/")
    place.parent.mkdir(parents=True, exist_ok=True)
    Image.new("RGB", (8, 8), color).save(place)
    return folder / name


def is_red(path: Path) -> bool:
    red, green, blue = load_mesh(path).texture.reshape(-1, 3).mean(0)
    return bool(red > 200 and max(green, blue) < 30)


@pytest.mark.parametrize("picture", ["t.png", "deeper/t.png", "../images/t.png", "..\\images\\t.png"])
def test_textures_of_the_model_s_own_tree_are_read(picture: str, tmp_path: Path) -> None:
    assert is_red(model(tmp_path / "id/models", picture, name="model_normalized.obj"))


@pytest.mark.parametrize(
    ("folder", "picture"),
    [("mesh", "../images/t.png"), ("id/models", "../../images/t.png"), ("id/models", "../images/../../t.png")],
)
def test_pictures_of_others_are_not_read_and_that_is_reported(
    folder: str, picture: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "id/images").mkdir(parents=True)
    with caplog.at_level(logging.WARNING):
        assert not is_red(model(tmp_path / folder, picture))
    assert "is read without" in caplog.text
    assert "no file of that name in the mesh's own folders" in caplog.text


def test_a_link_out_of_the_tree_is_not_followed(tmp_path: Path) -> None:
    path, other = model(tmp_path / "id/models", "../images/t.png"), tmp_path / "other"
    (tmp_path / "id/images").rename(other)
    (tmp_path / "id/images").symlink_to(other)
    assert not is_red(path)
    (tmp_path / "id/images").unlink()
    (tmp_path / "id/images").mkdir()
    (tmp_path / "id/images/t.png").symlink_to(other / "t.png")
    assert not is_red(path)


def test_what_cannot_be_read_is_named_with_its_reason(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = model(tmp_path, "t.png")
    (tmp_path / "t.png").write_bytes(b"no picture")
    with caplog.at_level(logging.WARNING):
        load_mesh(path)
    assert "'t.png' (no picture that can be read: UnidentifiedImageError)" in caplog.text
    (tmp_path / "m.mtl").unlink()
    with caplog.at_level(logging.WARNING):
        load_mesh(path)
    assert "'m.mtl' (no file of that name" in caplog.text


def ends(work: Callable[[], object]) -> None:
    """Fail where the work waits for ever."""
    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    thread.join(60)
    assert not thread.is_alive()


@pytest.mark.parametrize("pipe", ["m.mtl", "t.png"])
def test_no_pipe_is_waited_for_as_material_or_texture(pipe: str, tmp_path: Path) -> None:
    path = model(tmp_path, "t.png")
    (tmp_path / pipe).unlink()
    os.mkfifo(tmp_path / pipe)
    ends(lambda: load_mesh(path))
    assert not is_red(path)


def test_no_pipe_is_waited_for_as_buffer_or_views(tmp_path: Path) -> None:
    for name in ("b.bin", "v.h5"):
        os.mkfifo(tmp_path / name)
    head = {
        "asset": {"version": "2.0"},
        "buffers": [{"uri": "b.bin", "byteLength": 36}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
    }
    (tmp_path / "m.glb").write_bytes(glb(head))
    for read, name in ((load_mesh, "m.glb"), (Views, "v.h5")):
        refused: list[str] = []

        def attempt(read: Callable[[Path], Any] = read, name: str = name, refused: list[str] = refused) -> None:
            with pytest.raises((ValueError, OSError)) as error:
                read(tmp_path / name)
            refused.append(str(error.value))

        ends(attempt)
        assert name in refused[0]


def glb(head: dict[str, Any]) -> bytes:
    text = json.dumps(head).encode()
    text += b" " * (-len(text) % 4)
    return struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text), len(text), b"JSON") + text


def test_what_has_too_many_parts_is_refused_before_it_is_read(tmp_path: Path) -> None:
    path = model(tmp_path, "t.png")
    corners = MESH.split("usemtl a\n")[1].split("f ")[0]
    path.write_text("mtllib m.mtl\n" + corners + "".join(f"usemtl a{n}\nf 1/1 2/2 3/3\n" for n in range(20_000)))
    with pytest.raises(ValueError, match="uses 20,000 materials 20,000 times"):
        load_mesh(path)
    path.write_text(MESH)
    for entry in ("newmtl a{}\n", "map_Kd t.png\n"):
        (tmp_path / "m.mtl").write_text("newmtl a\n" + "".join(entry.format(n) for n in range(10**5)))
        with pytest.raises(ValueError, match="materials and textures, more than 4,000"):
            load_mesh(path)
    primitives = [{"attributes": {"POSITION": 0}}] * 10**5
    (tmp_path / "m.glb").write_bytes(glb({"asset": {"version": "2.0"}, "meshes": [{"primitives": primitives}]}))
    with pytest.raises(ValueError, match="100,000 primitives, materials and textures"):
        load_mesh(tmp_path / "m.glb")


def test_an_identity_changes_with_any_content_of_the_tree_and_with_nothing_else(tmp_path: Path) -> None:
    path, copy = (model(tmp_path / name / "models", "../images/t.png") for name in ("id", "copy"))
    first, same = mesh_identities([path, copy])
    assert first == same
    observed = {first}
    for file, old, new in [
        (path, b"v 0 1 0", b"v 0 2 0"),
        (path.with_name("m.mtl"), b"Kd 1 1 1", b"Kd 1 0 1"),
        (path.parent.parent / "images/t.png", b"IEND", b"IENE"),
    ]:
        file.write_bytes(file.read_bytes().replace(old, new))
        (changed,) = mesh_identities([path])
        assert changed not in observed
        observed.add(changed)
    assert mesh_identities([copy]) == [first]


def test_a_mesh_edited_in_place_with_the_same_size_is_drawn_anew(tmp_path: Path) -> None:
    path, views = model(tmp_path, "t.png"), tmp_path / "views.h5"
    before = Views(build_views(views, [path], 1, 2, 16)).extents
    made = views.stat().st_mtime_ns
    build_views(views, [path], 1, 2, 16)
    assert views.stat().st_mtime_ns == made
    path.write_text(MESH.replace("v 1 0 0", "v 3 0 0"))
    after = Views(build_views(views, [path], 1, 2, 16)).extents
    assert before is not None
    assert after is not None
    assert (np.abs(after - before) > 0.1).any()
