from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from kfit.segmentation import read_photo
from kfit.segmentation.file_kinds import is_heif

HEAD = b"\x00\x00\x00\x1cftyp%s\x00\x00\x00\x00mif1heic"


@pytest.mark.parametrize(("brand", "heif"), [(b"heic", True), (b"mif1", True), (b"avif", False), (b"isom", False)])
def test_heif_is_recognised_by_its_brand_whatever_its_name(tmp_path: Path, brand: bytes, heif: bool) -> None:
    file = tmp_path / "photo.jpg"
    file.write_bytes(HEAD % brand)
    assert is_heif(file) is heif


def test_a_heic_photo_without_its_decoder_names_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "pillow_heif", None)
    monkeypatch.delitem(Image.OPEN, "HEIF", raising=False)
    file = tmp_path / "IMG_0001.HEIC"
    file.write_bytes(HEAD % b"heic")
    with pytest.raises(ImportError, match=r"pip install 'kfit\[heif\]'"):
        read_photo(file)


def test_a_heic_photo_is_read_where_its_decoder_is_installed(tmp_path: Path) -> None:
    heif = pytest.importorskip("pillow_heif")
    picture = Image.fromarray(np.full((40, 60, 3), (200, 30, 30), np.uint8))
    heif.from_pillow(picture).save(tmp_path / "a.heic")
    photo = read_photo(tmp_path / "a.heic")
    assert photo.image.shape == (40, 60, 3)
    np.testing.assert_allclose(photo.image[20, 30], (0.78, 0.12, 0.12), atol=0.05)


def test_avif_is_read(tmp_path: Path) -> None:
    Image.fromarray(np.full((40, 60, 3), (200, 30, 30), np.uint8)).save(tmp_path / "a.avif")
    np.testing.assert_allclose(read_photo(tmp_path / "a.avif").image[20, 30], (0.78, 0.12, 0.12), atol=0.05)


def test_a_video_points_to_kfit_video(tmp_path: Path) -> None:
    (tmp_path / "clip.mp4").write_bytes(HEAD % b"isom")
    with pytest.raises(ValueError, match=r"clip\.mp4 is a video, not a photo: `kfit video`"):
        read_photo(tmp_path / "clip.mp4")


@pytest.mark.parametrize("address", ["https://example.org/a.jpg", "http://example.org/a.jpg", "s3://bucket/a.jpg"])
def test_an_address_is_no_file(address: str) -> None:
    with pytest.raises(ValueError, match="is an address; kfit reads files alone: download"):
        read_photo(address)
