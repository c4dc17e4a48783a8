"""Pictures of any kind, and what may be given beside them: each is read, or refused in a sentence that names it."""

from __future__ import annotations

import io
import os
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image, ImageCms

from kfit.cli.main import main
from kfit.fitting.pipeline import FitPipeline
from kfit.geometry import CATEGORIES
from kfit.pose.category_model import CategoryModel
from kfit.pose.observed_object import ObservedObject
from kfit.segmentation import Frames, Photo, depth_from_file, mask_from_alpha, mask_from_file, read_photo
from kfit.segmentation.photo import LARGEST_PICTURE, LARGEST_SIDE

RNG = np.random.default_rng(0)
PIXELS = RNG.integers(0, 256, (48, 64, 3), np.uint8)
NOISE = Image.fromarray(PIXELS)
MASK = np.zeros((48, 64), np.uint8)
MASK[8:30, 20:50] = 255
KINDS = ("png", "jpg", "gif", "tif", "webp", "bmp", "ppm", "tga", "jp2", "avif")
CAMERA = np.array([[60.0, 0, 32], [0, 60, 24], [0, 0, 1]])


def encoded(kind: str) -> bytes:
    file = io.BytesIO()
    NOISE.save(file, {"jpg": "JPEG", "tif": "TIFF", "jp2": "JPEG2000"}.get(kind, kind.upper()))
    return file.getvalue()


def check_read(photo: Photo) -> None:
    assert photo.image.dtype == np.float32
    assert photo.image.ndim == 3
    assert photo.image.shape[2] == 3
    assert 0 <= photo.image.min() <= photo.image.max() <= 1


def outcome(read: Callable[[], object]) -> str:
    """What a reader says against a file, in one line; nothing if it reads it."""
    try:
        read()
    except ValueError as error:
        return str(error)
    return ""


def check_read_or_refused(path: Path) -> bool:
    """By all readers of pictures; whether the photo was refused."""
    found = [
        outcome(lambda: np.isfinite(mask_from_file(path, (48, 64))).all() or pytest.fail("not finite")),
        outcome(lambda: depth_from_file(path, (48, 64))),
        outcome(lambda: check_read(read_photo(path))),
    ]
    assert all(str(path) in sentence and "\n" not in sentence for sentence in found if sentence)
    return bool(found[-1])


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_cut_and_damaged_pictures_are_read_or_refused(kind: str, tmp_path: Path) -> None:
    whole, path, rng = encoded(kind), tmp_path / f"p.{kind}", np.random.default_rng(1)
    path.write_bytes(whole)
    assert not check_read_or_refused(path)
    lengths = (0, 1, 2, 5, 8, 10, 20, 33, 40, len(whole) // 4, len(whole) // 2, len(whole) * 3 // 4)
    for length in lengths:
        path.write_bytes(whole[:length])
        assert check_read_or_refused(path)
    for number in range(16):
        damaged = bytearray(whole)
        for place in rng.integers(len(whole), size=1 + number):
            damaged[place] = rng.integers(256)
        path.write_bytes(bytes(damaged))
        check_read_or_refused(path)


PROFILE = ImageCms.ImageCmsProfile(ImageCms.createProfile("LAB")).tobytes()
ODD: dict[str, tuple[str, Image.Image, dict[str, Any]]] = {
    "one pixel": ("png", Image.new("RGB", (1, 1)), {}),
    "a column": ("png", Image.new("RGB", (1, 500)), {}),
    "a row": ("png", Image.new("RGB", (500, 1)), {}),
    **{f"mode {mode}": ("tif", NOISE.convert(mode), {}) for mode in ("1", "L", "P", "LA", "RGBA", "CMYK", "LAB", "I")},
    "16 bits": ("png", Image.fromarray(RNG.integers(0, 65536, (48, 64)).astype(np.uint16)), {}),
    "a JPEG of inks": ("jpg", NOISE.convert("CMYK"), {}),
    "a palette with a transparent colour": ("png", NOISE.convert("P"), {"transparency": 3}),
    "grey with a transparent level": ("png", NOISE.convert("L"), {"transparency": 3}),
    "all transparent": ("png", NOISE.convert("RGBA").point(lambda value: 0), {}),
    "animated": ("gif", NOISE.convert("P"), {"save_all": True, "append_images": [Image.new("P", (64, 48))]}),
    "several pages": ("tif", NOISE, {"save_all": True, "append_images": [Image.new("L", (9, 9))]}),
    "a colour profile": ("png", NOISE, {"icc_profile": PROFILE}),
    "a broken colour profile": ("jpg", NOISE, {"icc_profile": b"no profile"}),
    "broken EXIF tags": ("jpg", NOISE, {"exif": b"Exif\0\0II*\0\xff\xff\xff\xff"}),
}  # fmt: skip


@pytest.mark.parametrize("odd", ODD)
def test_odd_pictures_are_read(odd: str, tmp_path: Path) -> None:
    kind, picture, settings = ODD[odd]
    path = tmp_path / f"p.{kind}"
    picture.save(path, **settings)
    photo = read_photo(path)
    check_read(photo)
    assert photo.image.shape[:2] == (picture.height, picture.width)
    if odd in ("several pages", "animated"):  # the first one
        assert photo.image.std() > 0.1
    if odd == "all transparent":
        assert mask_from_alpha(photo.alpha) is None


def test_a_wrong_ending_does_not_matter(tmp_path: Path) -> None:
    (tmp_path / "p.png").write_bytes(encoded("webp"))
    check_read(read_photo(tmp_path / "p.png"))


def test_a_program_that_draws_a_picture_is_not_run(tmp_path: Path) -> None:
    NOISE.save(tmp_path / "p.eps")
    (tmp_path / "p.jpg").write_bytes((tmp_path / "p.eps").read_bytes())
    for name in ("p.eps", "p.jpg"):
        with pytest.raises(ValueError, match="is not an image that can be read"):
            read_photo(tmp_path / name)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_a_photo_turned_by_exif_is_the_upright_one(orientation: int, tmp_path: Path) -> None:
    back = {2: 0, 3: 3, 4: 1, 5: 5, 6: 2, 7: 6, 8: 4}  # Pillow's transpositions that undo what the tag asks for
    exif = Image.Exif()
    exif[0x0112] = orientation
    stored = NOISE if orientation == 1 else NOISE.transpose(Image.Transpose(back[orientation]))
    stored.save(tmp_path / "p.png", exif=exif)
    mask = (MASK > 0).astype(np.float32)
    upright, observed = (
        ObservedObject.of(photo, CATEGORIES["mug"], 32, mask, intrinsics=CAMERA)
        for photo in (PIXELS, tmp_path / "p.png")
    )
    np.testing.assert_array_equal(observed.image, upright.image)
    for field in ("image", "mask"):
        assert torch.equal(observed.observation.field(field), upright.observation.field(field))


@pytest.mark.parametrize(
    "size",
    [
        (10_001, 1),
        (9_999, 9_999),
        *(pytest.param(size, marks=pytest.mark.slow) for size in ((20_000,) * 2, (12_000, 9_000))),
    ],
)
def test_a_picture_of_far_too_many_pixels_takes_no_memory(size: tuple[int, int], tmp_path: Path) -> None:
    Image.new("1", size).save(tmp_path / "p.png")
    tracemalloc.start()
    with pytest.raises(ValueError, match="at most 10,000 on a side and 65 million are read"):
        read_photo(tmp_path / "p.png")
    assert tracemalloc.get_traced_memory()[1] < 50e6
    tracemalloc.stop()


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no pipes here")
@pytest.mark.parametrize("place", ["pipe.png", "folder.png", "pipe.npy", "folder.npy", "/dev/zero", "/dev/null", ""])
def test_what_is_no_file_is_not_waited_for(place: str, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.png")
    os.mkfifo(tmp_path / "pipe.npy")
    (tmp_path / "folder.png").mkdir()
    (tmp_path / "folder.npy").mkdir()
    path = tmp_path / place if place else ""
    for read in (read_photo, lambda path: mask_from_file(path, (4, 4)), lambda path: depth_from_file(path, (4, 4))):
        with pytest.raises(ValueError, match="is no file"):
            read(path)
    if place.startswith("pipe"):
        with pytest.raises(ValueError, match="neither a file nor a folder"):
            Frames.of(path)


MASKS = {
    "one pixel": np.eye(48, 64, dtype=np.uint8) * (np.arange(48) == 20)[:, None],
    "full": np.full((48, 64), 255, np.uint8),
    "labels": np.repeat(np.arange(3, dtype=np.uint8), 16)[:, None].repeat(64, 1),
}


@pytest.mark.parametrize("mask", MASKS)
def test_odd_masks_are_taken(mask: str, tmp_path: Path) -> None:
    Image.fromarray(MASKS[mask]).save(tmp_path / "m.png")
    found = mask_from_file(tmp_path / "m.png", (48, 64))
    np.testing.assert_array_equal(found, MASKS[mask] > 0)
    for kind in (np.uint8, bool, np.float64, np.int32):
        observed = ObservedObject.of(PIXELS, CATEGORIES["mug"], 32, MASKS[mask].astype(kind))
        np.testing.assert_array_equal(observed.mask, MASKS[mask] > 0)
        assert bool(observed.observation.field("image").isfinite().all())


@pytest.mark.slow
@pytest.mark.parametrize("orientation", [6])
def test_a_command_with_a_photo_turned_by_exif_takes_mask_and_box_in_upright_pixels(
    orientation: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    exif = Image.Exif()
    exif[0x0112] = orientation
    NOISE.transpose(Image.Transpose.ROTATE_90).save(tmp_path / "p.jpg", exif=exif)
    Image.fromarray(MASK).save(tmp_path / "m.png")
    recorded: list[torch.Tensor] = []

    class Reached(BaseException):
        pass

    def fit(_: FitPipeline, observation: Any, **__: Any) -> None:
        recorded.append(observation.field("mask"))
        raise Reached

    monkeypatch.setattr(FitPipeline, "forward", fit)
    with pytest.raises(Reached):
        main(["pose", str(tmp_path / "p.jpg"), "--category", "mug", "--mask", str(tmp_path / "m.png")])
    assert recorded[0].mean() > 0.3  # it is not turned away


def test_names_of_any_letters_are_reported_on_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in (
        "a\nb.png",
        "a\x1b[31mb.png",
        "a\udcffb.png",
        "\u202ea.png",
        "ü 一.png",
        " .png",
        "-.png",
        "a\0b",
        "x" * 300,
    ):
        with pytest.raises(SystemExit) as end:
            main(["pose", "--category", "mug", "--", name])
        printed = capsys.readouterr()
        assert end.value.code == 2
        assert (printed.out, printed.err.count("\n")) == ("", 1)
        assert printed.err[:-1].isprintable()
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("files", "outcome"),
    [
        ({}, "holds no pictures"),
        ({"1.png": NOISE, "2.png": NOISE.resize((30, 30))}, "2.png has 30 x 30 pixels, the first 64 x 48"),
        ({"1.png": b"garbage", "2.png": NOISE}, "1.png is not an image that can be read"),
        ({"1.png": NOISE, "2.png": encoded("png")[:999]}, "2.png is damaged or cut short"),
    ],
)
def test_a_folder_of_odd_frames_ends_in_a_sentence(files: dict[str, Any], outcome: str, tmp_path: Path) -> None:
    for name, content in files.items():
        (tmp_path / name).write_bytes(content) if isinstance(content, bytes) else content.save(tmp_path / name)
    with pytest.raises((ValueError, FileNotFoundError), match=outcome):
        list(Frames.of(tmp_path))


@pytest.mark.slow
@pytest.mark.parametrize("size", [(1, 1), (1, 500), (500, 1), (3, 3)])
@pytest.mark.parametrize("depth", [False, True])
def test_pictures_of_few_pixels_are_answered(size: tuple[int, int], depth: bool, mug: CategoryModel) -> None:
    image, mask = np.full((*size, 3), 128, np.uint8), np.ones(size, np.float32)
    near = 0.12 * mask if depth else None  # metres, at which the assumed lens makes the picture as large as a mug
    answer = mug.pose(image, mask=mask, depth=near, pipeline=mug.pipeline(2, 2, depth=depth, lens_known=False))
    assert np.isfinite(answer.rotation).all()
    assert np.isfinite(answer.translation).all()


@pytest.mark.slow
def test_the_largest_picture_is_read_in_three_gigabytes(tmp_path: Path) -> None:
    assert LARGEST_PICTURE % LARGEST_SIDE == 0
    Image.new("RGB", (LARGEST_SIDE, LARGEST_PICTURE // LARGEST_SIDE), (9, 9, 9)).save(tmp_path / "p.png")
    tracemalloc.start()
    check_read(read_photo(tmp_path / "p.png"))
    assert tracemalloc.get_traced_memory()[1] < 3e9
    tracemalloc.stop()
