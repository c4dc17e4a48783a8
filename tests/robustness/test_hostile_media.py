"""Pictures, clips, meshes and recipes of strangers: what they name elsewhere is left alone, however large it claims."""

from __future__ import annotations

import io
import json
import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import EpsImagePlugin, Image

from kfit.cli.main import main
from kfit.data.mesh_files import load_mesh
from kfit.data.nocs_frame import read_depth
from kfit.data.nocs_models import read_meta
from kfit.data.nocs_results import write_result
from kfit.models import load
from kfit.pose.fit_recipe import fit_of
from kfit.runtime.console import log, session
from kfit.runtime.recipe_limits import check_recipe
from kfit.segmentation import Frames, read_photo

POSTSCRIPT = b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 8 8\n%%EndComments\nshowpage\n%%EOF\n"
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32).tobytes()
PLACES = np.array([[0, 0], [1, 0], [0, 1]], np.float32).tobytes()
TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\n"


@pytest.fixture
def ghostscript(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A program of that name, and what it leaves when it is run."""
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin/gs").write_text(f"#!/bin/sh\necho 10 | tee {tmp_path}/ran\n")
    (tmp_path / "bin/gs").chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}/bin:/bin:/usr/bin")
    monkeypatch.setattr(EpsImagePlugin, "gs_binary", None)
    return tmp_path / "ran"


def test_postscript_is_not_run_whatever_it_is_called(ghostscript: Path, tmp_path: Path) -> None:
    for name in ("photo.png", "photo.jpg", "photo.eps"):
        (tmp_path / name).write_bytes(POSTSCRIPT)
        with pytest.raises(ValueError, match="not an image"):
            read_photo(tmp_path / name)
    (tmp_path / "m.mtl").write_text("newmtl a\nmap_Kd photo.png\n")
    (tmp_path / "m.obj").write_text(f"mtllib m.mtl\nusemtl a\n{TRIANGLE}f 1/1 2/2 3/3\n")
    (tmp_path / "m.glb").write_bytes(glb(POSTSCRIPT))
    for name in ("m.obj", "m.glb"):
        with pytest.raises(ValueError, match="readable mesh"):
            load_mesh(tmp_path / name)
    assert not ghostscript.exists()
    assert EpsImagePlugin.gs_binary is None


def test_a_clip_reads_no_other_file(tmp_path: Path) -> None:
    (tmp_path / "given").mkdir()
    for place in ("other.avi", "given/own.avi"):
        video = cv2.VideoWriter(str(tmp_path / place), cv2.VideoWriter.fourcc(*"MJPG"), 10, (64, 64))
        for _ in range(3):
            video.write(np.full((64, 64, 3), 200, np.uint8))
        video.release()
    assert len(list(Frames.of(tmp_path / "given/own.avi"))) == 3
    head, end = "#EXTM3U\n#EXT-X-TARGETDURATION:9\n#EXTINF:9,\n", "\n#EXT-X-ENDLIST\n"
    others = [
        f"{head}{place}{end}" for place in ("../other.avi", f"file://{tmp_path}/other.avi", "http://127.0.0.1:9/a")
    ]
    others += [f"ffconcat version 1.0\nfile {place}\n" for place in ("own.avi", "../other.avi")]
    for text in [*others, "hello\n" * 1000]:  # FFmpeg takes any text called .txt for a clip
        for ending in (".mp4", ".m3u8", ".avi", ".txt", ".ffconcat"):
            clip = tmp_path / f"given/clip{ending}"
            clip.write_text(text)
            with pytest.raises(ValueError, match="not a clip that can be read"):
                Frames.of(clip)
    for address in ("http://127.0.0.1:9/clip.mp4", f"file://{tmp_path}/other.avi", "concat:a|b", "pipe:0"):
        with pytest.raises(FileNotFoundError):
            Frames.of(address)


def glb(picture: bytes = b"", change: Callable[[dict[str, Any]], object] = lambda content: None) -> bytes:
    """A triangle with a texture."""
    held = CORNERS + PLACES + np.arange(3, dtype=np.uint32).tobytes()
    spans = [(0, 36), (36, 24), (60, 12), (72, len(picture))]
    content: dict[str, Any] = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [
            {"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2, "material": 0}]},
        ],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        "textures": [{"source": 0}],
        "images": [{"bufferView": 3, "mimeType": "image/png"}],
        "accessors": [
            {"bufferView": k, "componentType": kind, "count": 3, "type": shape}
            for k, (kind, shape) in enumerate(((5126, "VEC3"), (5126, "VEC2"), (5125, "SCALAR")))
        ],
        "bufferViews": [{"buffer": 0, "byteOffset": start, "byteLength": size} for start, size in spans],
        "buffers": [{"byteLength": 72 + len(picture)}],
    }
    change(content)
    text, held = json.dumps(content).encode(), held + picture
    text, held = text + b" " * (-len(text) % 4), held + b"\0" * (-len(held) % 4)
    body = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(held), b"BIN\0") + held
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


def plain(side: int, color: tuple[int, int, int] = (0, 255, 0)) -> bytes:
    file = io.BytesIO()
    Image.new("RGB", (side, side), color).save(file, "PNG")
    return file.getvalue()


def head(side: int) -> bytes:
    """A PNG that ends after saying how large it is."""
    header = b"IHDR" + struct.pack(">IIBBBBB", side, side, 8, 2, 0, 0, 0)
    start = b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + header + struct.pack(">I", zlib.crc32(header))
    return start + struct.pack(">I", 1000) + b"IDAT"


def test_a_mesh_reads_no_picture_elsewhere(tmp_path: Path) -> None:
    (tmp_path / "given").mkdir()
    (tmp_path / "secret.png").write_bytes(plain(8, (255, 0, 0)))
    (tmp_path / "given/link.png").symlink_to(tmp_path / "secret.png")
    (tmp_path / "given/own.png").write_bytes(plain(8))
    away = ["../secret.png", f"{tmp_path}/secret.png", f"file://{tmp_path}/secret.png", "%2e%2e/secret.png", "link.png"]
    for place in [*away, "http://127.0.0.1:9/x.png", "own.png"]:
        (tmp_path / "given/m.glb").write_bytes(glb(change=lambda content, p=place: content.update(images=[{"uri": p}])))
        (tmp_path / "given/m.mtl").write_text(f"newmtl a\nmap_Kd {place}\n")
        (tmp_path / "given/m.obj").write_text(f"mtllib m.mtl\nusemtl a\n{TRIANGLE}f 1/1 2/2 3/3\n")
        for name in ("m.glb", "m.obj"):
            red, green, _ = load_mesh(tmp_path / "given" / name).texture.max((0, 1)).astype(int)
            assert red <= green
    for place in ("../secret.png", "http://127.0.0.1:9/x.bin"):
        held = [{"uri": place, "byteLength": 72}]
        (tmp_path / "given/m.glb").write_bytes(glb(change=lambda content, held=held: content.update(buffers=held)))
        with pytest.raises(ValueError, match="readable mesh"):
            load_mesh(tmp_path / "given/m.glb")


def repeated(content: dict[str, Any]) -> None:
    content["nodes"] = [{"mesh": 0}] * 100_000
    content["scenes"] = [{"nodes": list(range(100_000))}]


GLBS: dict[str, tuple[bytes, str]] = {
    "values of no bytes": (
        glb(change=lambda content: content["accessors"][0].update(count=300_000_000, bufferView=None)),
        "its accessors have 300,000,006 values",
    ),
    "fewer corners than faces say": (
        glb(plain(4), lambda content: content["accessors"][0].update(count=-1)),
        "missing vertices",
    ),
    "repeated": (glb(plain(4), repeated), "it has 100,000 nodes"),
    "large texture": (glb(head(9000)), "its textures have 81,000,000 texels"),
    "far view": (glb(change=lambda content: content["bufferViews"][0].update(byteOffset=10**9)), "readable mesh"),
    "nested": (struct.pack("<4sIIII", b"glTF", 2, 10**6, 200_000, 0x4E4F534A) + b"[" * 200_000, "recursion"),
    "kind": (glb(change=lambda content: content["accessors"][0].update(type="MAT9")), "readable mesh"),
}


@pytest.mark.parametrize("kind", GLBS)
def test_a_mesh_that_stands_for_more_than_it_holds_is_refused(kind: str, tmp_path: Path) -> None:
    (tmp_path / "m.glb").write_bytes(GLBS[kind][0])
    with pytest.raises(ValueError, match=GLBS[kind][1]):
        load_mesh(tmp_path / "m.glb")


def test_one_picture_is_no_texture_of_thousands_of_materials(tmp_path: Path) -> None:
    (tmp_path / "p.png").write_bytes(plain(1024))
    (tmp_path / "m.mtl").write_text("".join(f"newmtl m{k}\nmap_Kd p.png\n" for k in range(500)))
    faces = "".join(f"usemtl m{k}\nf 1/1 2/2 3/3\n" for k in range(500))
    (tmp_path / "m.obj").write_text(f"mtllib m.mtl\n{TRIANGLE}{faces}")
    with pytest.raises(ValueError, match="its textures have 524,288,000 texels"):
        load_mesh(tmp_path / "m.obj")


def aliases(times: int, levels: int) -> str:
    lines = [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * times)}]\n" for k in range(1, levels)]
    return f"a0: &a0 [{', '.join('x' * times)}]\n{''.join(lines)}"


@pytest.mark.parametrize(
    "text", [aliases(9, 9), aliases(2, 60), "a: &a [*a]\n", "a: " + "{a: " * 3000 + "1" + "}" * 3000, " " * 200_001]
)
@pytest.mark.filterwarnings("ignore:LightningCLI's args parameter")
def test_a_recipe_that_stands_for_more_than_memory_holds_is_refused(
    text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recipe = tmp_path / "fit.yaml"
    recipe.write_text(text)
    with pytest.raises(ValueError, match=r"fit\.yaml is no recipe: "):
        fit_of(recipe, load("mug"))
    for words in (["fit", "-c", str(recipe)], ["predict", f"--config={recipe}"]):
        with pytest.raises(SystemExit):
            main(words)
        assert "fit.yaml is no recipe: " in capsys.readouterr().err


def test_an_alias_that_recipes_may_have_is_fine(tmp_path: Path) -> None:
    (tmp_path / "fit.yaml").write_text("a: &a {x: 1}\nb: [*a, *a]\n")
    check_recipe(tmp_path / "fit.yaml")


def test_a_data_set_names_nothing_outside(tmp_path: Path) -> None:
    (tmp_path / "models").mkdir()
    (tmp_path / "secret.txt").write_text("1 2 3")
    meta = tmp_path / "0000_meta.txt"
    for model in ("../secret", f"{tmp_path}/secret", ".. secret", "a/../../secret"):
        meta.write_text(f"1 6 {model}\n")
        with pytest.raises(ValueError, match="outside of the folder of models"):
            read_meta(meta, tmp_path / "models")
    meta.write_text("1 6 mug.npz\n")
    with zipfile.ZipFile(tmp_path / "models/mug.npz", "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("scale.npy", b"\0" * 10**7)
    with pytest.raises(ValueError, match="three numbers"):
        read_meta(meta, tmp_path / "models")
    Image.new("L", (10_001, 1)).save(tmp_path / "0000_depth.png")
    with pytest.raises(ValueError, match="not an image that can be read"):
        read_depth(tmp_path / "0000_depth.png")


@pytest.mark.parametrize("image", ["../../x", "/x", "/", "a/../../../x", "..", "-rf", "*", "a\x00b"])
def test_results_lie_in_their_folder_whatever_their_image_is_called(image: str, tmp_path: Path) -> None:
    out = tmp_path / "a/b/out"
    try:
        write_result(out, {"image_path": image})
    except ValueError:
        assert "\x00" in image
    written = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert all(path.is_relative_to(out) for path in written)


def test_what_a_file_says_does_not_steer_the_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    with session([]):
        log.warning("\x1b]8;;http://x\x07red\x1b[31m \x9b2J ‮ fine: °×\n")
    assert capsys.readouterr().err == ("kfit: \\x1b]8;;http://x\\x07red\\x1b[31m \\x9b2J \\u202e fine: °×\n\n")
