"""What the page takes, and what it refuses before it is decoded."""

import struct
import zlib

import numpy as np
import pytest
from PIL import Image

from kfit.app import uploads
from kfit.app.uploads import LARGEST_FILE, LARGEST_PICTURE, read_upload


def head_of_png(width, height):
    """A PNG that ends after saying how large it is."""
    header = b"IHDR" + struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    start = b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + header + struct.pack(">I", zlib.crc32(header))
    return start + struct.pack(">I", 1000) + b"IDAT"


@pytest.fixture
def decoded(monkeypatch):
    """Paths that were decoded."""
    paths = []
    monkeypatch.setattr(uploads, "read_photo", paths.append)
    return paths


@pytest.mark.parametrize("kind", ["jpg", "jpeg", "png", "webp"])
def test_the_kinds_that_phones_and_browsers_write_are_read(tmp_path, kind):
    path = tmp_path / f"photo.{kind}"
    Image.new("RGB", (30, 20), (200, 100, 50)).save(path)
    assert read_upload(path).image.shape == (20, 30, 3)


@pytest.mark.parametrize("kind", ["BMP", "TIFF", "GIF", "PPM"])
def test_other_kinds_are_refused_whatever_their_name(tmp_path, decoded, kind):
    path = tmp_path / "photo.png"
    Image.new("RGB", (30, 20)).save(path, kind)
    with pytest.raises(ValueError, match=r"^photo.png is no JPEG, PNG, WebP, AVIF or HEIC picture"):
        read_upload(path)
    assert decoded == []


@pytest.mark.parametrize("content", [b"", b"<svg xmlns='http://www.w3.org/2000/svg'/>", b"\x80\x04cos\nsystem\n."])
def test_what_is_no_picture_is_refused_in_one_sentence_without_the_servers_folder(tmp_path, content):
    path = tmp_path / "photo.jpg"
    path.write_bytes(content)
    with pytest.raises(
        ValueError, match=r"^photo.jpg is no JPEG, PNG, WebP, AVIF or HEIC picture, which the page takes$"
    ):
        read_upload(path)


def test_a_picture_of_too_many_pixels_is_refused_before_it_is_decoded(tmp_path, decoded):
    path = tmp_path / "photo.png"
    path.write_bytes(head_of_png(8000, LARGEST_PICTURE // 8000 + 1))
    with pytest.raises(ValueError, match=r"^photo.png has 8000 x 8126 pixels; .* at most 65 megapixels$"):
        read_upload(path)
    path.write_bytes(head_of_png(60_000, 60_000))  # Pillow itself refuses to open it
    with pytest.raises(ValueError, match=r"^photo.png has far too many pixels"):
        read_upload(path)
    assert decoded == []
    path.write_bytes(head_of_png(8000, LARGEST_PICTURE // 8000))
    read_upload(path)
    assert decoded == [path]


def test_a_file_of_too_many_bytes_is_refused_before_it_is_opened(tmp_path, decoded):
    path = tmp_path / "photo.png"
    path.write_bytes(head_of_png(30, 20))
    with path.open("ab") as file:
        file.truncate(LARGEST_FILE + 1)
    with pytest.raises(ValueError, match=r"^photo.png has 64.0 MB; the page takes pictures of at most 64$"):
        read_upload(path)
    assert decoded == []


def test_a_damaged_picture_is_reported_by_its_name_alone(tmp_path):
    path = tmp_path / "photo.jpg"
    Image.fromarray(np.random.default_rng(0).integers(0, 255, (64, 64, 3), dtype=np.uint8)).save(path)
    path.write_bytes(path.read_bytes()[:800])
    with pytest.raises(ValueError, match=r"^photo.jpg is damaged or cut short$"):
        read_upload(path)
