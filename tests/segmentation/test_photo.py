from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image
from skimage.io import imsave

from kfit.segmentation import depth_from_file, mask_from_alpha, mask_from_file, photo, read_photo

RGB = np.random.default_rng(0).integers(0, 256, (6, 9, 3), np.uint8)


def saved(folder: Path, name: str, picture: Image.Image, **how: object) -> Path:
    picture.save(folder / name, **how)
    return folder / name


def test_a_photo_comes_as_rgb_between_zero_and_one(tmp_path: Path) -> None:
    read = read_photo(saved(tmp_path, "a.png", Image.fromarray(RGB)))
    assert read.image.dtype == np.float32
    np.testing.assert_allclose(read.image, RGB / 255, atol=1e-6)
    assert read.alpha is None
    assert read.intrinsics is None


def test_the_exif_rotation_is_carried_out_and_the_lens_is_read(tmp_path: Path) -> None:
    tags = Image.Exif()
    tags[0x112] = 6  # held upright: to be turned a quarter clockwise
    tags.get_ifd(0x8769)[0xA405] = 26
    read = read_photo(saved(tmp_path, "a.png", Image.fromarray(RGB), exif=tags))
    np.testing.assert_allclose(read.image, np.rot90(RGB, -1) / 255, atol=1e-6)
    assert read.intrinsics is not None
    # 26 mm · √(6² + 9²) px / 43.267 mm, principal point in the middle of the picture 6 wide and 9 high.
    expected = [[6.5, 0, 2.5], [0, 6.5, 4.0], [0, 0, 1]]
    np.testing.assert_allclose(read.intrinsics, expected, atol=1e-3)


@pytest.mark.parametrize("mode", ["L", "1", "P", "CMYK", "LA", "RGBA"])
def test_every_kind_of_pixel_becomes_rgb(tmp_path: Path, mode: str) -> None:
    picture = Image.fromarray(RGB).convert(mode)
    read = read_photo(saved(tmp_path, "a.tif", picture))
    np.testing.assert_allclose(read.image, np.asarray(picture.convert("RGB")) / 255, atol=1e-6)
    assert (read.alpha is not None) == mode.endswith("A")


def test_sixteen_bits_of_grey_keep_their_range(tmp_path: Path) -> None:
    grey = np.array([[0, 1000, 30000], [65535, 400, 50000]], np.uint16)
    cv2.imwrite(str(tmp_path / "a.png"), grey)
    read = read_photo(tmp_path / "a.png")
    assert read.image.shape == (2, 3, 3)
    np.testing.assert_allclose(read.image[..., 0], grey / 65535, atol=1e-6)


def test_sixteen_bits_of_colour_are_right_to_a_byte(tmp_path: Path) -> None:
    colour = np.random.default_rng(0).integers(0, 65536, (4, 5, 3), np.uint16)
    cv2.imwrite(str(tmp_path / "a.png"), colour)
    np.testing.assert_allclose(read_photo(tmp_path / "a.png").image, colour[..., ::-1] / 65535, atol=1 / 255)


def test_alpha_comes_beside_the_colours(tmp_path: Path) -> None:
    alpha = np.zeros((6, 9, 1), np.uint8)
    alpha[2:4] = 255
    read = read_photo(saved(tmp_path, "a.png", Image.fromarray(np.concatenate((RGB, alpha), 2))))
    np.testing.assert_allclose(read.image, RGB / 255, atol=1e-6)
    mask = mask_from_alpha(read.alpha)
    assert mask is not None
    assert mask.dtype == np.float32
    np.testing.assert_array_equal(mask, alpha[..., 0] / 255)


@pytest.mark.parametrize("alpha", [None, np.ones((4, 4), np.float32), np.full((4, 4), 0.5, np.float32)])
def test_alpha_that_sets_nothing_off_is_no_mask(alpha: np.ndarray | None) -> None:
    assert mask_from_alpha(alpha) is None


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"there is no file .*none\.png"):
        read_photo(tmp_path / "none.png")


def test_a_text_is_no_image(tmp_path: Path) -> None:
    (tmp_path / "a.jpg").write_text("hello")
    with pytest.raises(ValueError, match=r"a\.jpg is not an image that can be read"):
        read_photo(tmp_path / "a.jpg")
    with pytest.raises(ValueError, match="is not an image that can be read"):
        read_photo(tmp_path)


@pytest.mark.parametrize("name", ["a.png", "a.jpg"])
def test_half_a_file_is_damaged(tmp_path: Path, name: str) -> None:
    noise = np.random.default_rng(0).integers(0, 256, (64, 64, 3), np.uint8)
    path = saved(tmp_path, name, Image.fromarray(noise))
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(ValueError, match=f"{name} is damaged or cut short"):
        read_photo(path)


def test_a_picture_too_large_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = saved(tmp_path, "a.png", Image.new("1", (10_001, 4)))
    with pytest.raises(ValueError, match="has 10001 x 4 pixels; at most 10,000 on a side and 65 million are read"):
        read_photo(path)
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 1000)
    with pytest.raises(ValueError, match="has far too many pixels; at most"):
        read_photo(path)


def test_a_clear_grey_of_sixteen_bits_becomes_alpha_and_the_others_stay(tmp_path: Path) -> None:
    grey = np.array([[0, 1000, 30000], [65535, 400, 50000]], np.uint16)
    read = read_photo(saved(tmp_path, "a.png", Image.fromarray(grey), transparency=400))
    np.testing.assert_allclose(read.image[..., 0], grey / 65535, atol=1e-6)
    assert read.alpha is not None
    np.testing.assert_array_equal(read.alpha, grey != 400)


def test_a_tiff_of_colours_that_cannot_be_read_is_not_just_called_damaged(tmp_path: Path) -> None:
    path = saved(tmp_path, "a.tif", Image.fromarray(RGB).convert("YCbCr"))
    with pytest.raises(ValueError, match=r"a\.tif is damaged, or a TIFF of YCbCr colours, which is to be saved as RGB"):
        read_photo(path)


def test_a_cropped_photo_says_what_its_camera_rests_on(tmp_path: Path) -> None:
    tags = Image.Exif()
    tags[0x112] = 1
    tags.get_ifd(0x8769).update({0xA405: 27, 0xA002: 12, 0xA003: 6})
    read = read_photo(saved(tmp_path, "a.png", Image.fromarray(RGB), exif=tags))
    assert read.intrinsics is not None
    assert float(read.intrinsics[0, 0]) == pytest.approx(27 * 180**0.5 / 43.267, abs=1e-3)
    assert "cropped" in read.camera_notes[0]


def test_floating_point_numbers_are_no_photo(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="floating-point numbers of unknown range"):
        read_photo(saved(tmp_path, "a.tif", Image.new("F", (4, 4))))


@pytest.mark.parametrize(
    ("mode", "value"), [("L", 1), ("L", 255), ("RGB", (0, 0, 9)), ("RGBA", (9, 0, 0, 255)), ("I;16", 300)]
)
def test_small_numbers_other_than_zero_are_labels_of_objects(tmp_path: Path, mode: str, value: object) -> None:
    picture = Image.new(mode, (9, 6))
    picture.putpixel((4, 2), value)  # type: ignore[arg-type]
    mask = mask_from_file(saved(tmp_path, "m.png", picture), (6, 9))
    assert mask.dtype == np.float32
    assert mask.sum() == 1
    assert mask[2, 4] == 1


def test_in_a_palette_entry_zero_is_background_whatever_its_colour(tmp_path: Path) -> None:
    picture = Image.new("P", (9, 6), 0)
    picture.putpalette([200, 100, 50, 0, 0, 0])
    picture.putpixel((4, 2), 1)
    assert mask_from_file(saved(tmp_path, "m.png", picture), (6, 9)).sum() == 1


@pytest.mark.parametrize(
    ("name", "how"),
    [
        ("m.jpg", {"quality": 60}),
        ("m.webp", {"quality": 10}),
        ("m.mpo", {"quality": 60, "save_all": True, "append_images": [Image.new("L", (64, 64))]}),
        ("m.jp2", {"quality_layers": [5]}),
    ],
)
def test_what_a_lossy_format_blurs_is_not_object(tmp_path: Path, name: str, how: dict[str, object]) -> None:
    values = np.zeros((64, 64), np.uint8)
    values[20:43, 17:40] = 255
    path = saved(tmp_path, name, Image.fromarray(values), **how)
    np.testing.assert_array_equal(mask_from_file(path, (64, 64)), values / 255)


def test_what_noise_a_lossy_format_leaves_of_nothing_is_no_label(tmp_path: Path) -> None:
    noise = np.random.default_rng(0).integers(0, 9, (64, 64), np.uint8)
    path = saved(tmp_path, "m.jpg", Image.fromarray(noise), quality=90)
    assert mask_from_file(path, (64, 64), may_be_empty=True).sum() == 0


def test_a_soft_matte_counts_from_one_half_on(tmp_path: Path) -> None:
    hard = np.zeros((64, 64), np.uint8)
    hard[20:43, 17:40] = 255
    soft = cv2.GaussianBlur(hard, (0, 0), 3)
    # the blur leaves the sides of a square where they are, and rounds its corners
    found = mask_from_file(saved(tmp_path, "m.png", Image.fromarray(soft)), (64, 64))
    np.testing.assert_array_equal(found[30], hard[30] / 255)
    np.testing.assert_array_equal(found[:, 30], hard[:, 30] / 255)


def test_a_palette_of_greys_is_read_as_greys(tmp_path: Path) -> None:
    # as programs write that make small files: entry 0 need not be black
    picture = Image.new("P", (9, 6), 1)
    picture.putpalette([255, 255, 255, 0, 0, 0])
    picture.putpixel((4, 2), 0)
    mask = mask_from_file(saved(tmp_path, "m.png", picture), (6, 9))
    assert mask.sum() == 1
    assert mask[2, 4] == 1


def test_a_mask_of_another_size_or_without_object_is_refused(tmp_path: Path) -> None:
    path = saved(tmp_path, "m.png", Image.new("L", (9, 6)))
    with pytest.raises(ValueError, match=r"m.png has 9 x 6 pixels, the photo 10 x 6"):
        mask_from_file(path, (6, 10))
    with pytest.raises(ValueError, match=r"m.png is empty: none of its pixels is above one half"):
        mask_from_file(path, (6, 9))


def test_the_limit_is_what_the_message_says() -> None:
    assert photo.LARGEST_SIDE == 10_000


def test_depth_comes_in_metres_from_millimetres_or_an_array(tmp_path: Path) -> None:
    millimetres = np.array([[0, 500], [1500, 65535]], np.uint16)
    imsave(tmp_path / "d.png", millimetres, check_contrast=False)
    np.save(tmp_path / "d.npy", millimetres / 1000)
    for name in ("d.png", "d.npy"):
        found = depth_from_file(tmp_path / name, (2, 2))
        assert found.dtype == np.float32
        np.testing.assert_allclose(found, millimetres / 1000, rtol=1e-6)


def test_depth_that_cannot_be_used_gets_one_sentence(tmp_path: Path) -> None:
    imsave(tmp_path / "bytes.png", np.ones((2, 2), np.uint8), check_contrast=False)
    imsave(tmp_path / "zero.png", np.zeros((2, 2), np.uint16), check_contrast=False)
    np.save(tmp_path / "whole.npy", np.ones((2, 2), np.int64))
    np.save(tmp_path / "objects.npy", np.array([[{}]], object), allow_pickle=True)
    np.save(tmp_path / "nan.npy", np.full((2, 2), np.nan))
    (tmp_path / "cut.npy").write_bytes((tmp_path / "nan.npy").read_bytes()[:90])
    for name, sentence in [
        ("none.npy", "there is no file"),
        ("none.png", "there is no file"),
        ("bytes.png", "16-bit picture of millimetres, got one of mode L"),
        ("zero.png", "unknown everywhere"),
        ("nan.npy", "unknown everywhere"),
        ("whole.npy", r"must hold \(H, W\) metres of floating point"),
        ("objects.npy", "damaged or no array of numbers"),
        ("cut.npy", "damaged or no array of numbers"),
    ]:
        with pytest.raises((ValueError, FileNotFoundError), match=sentence):
            depth_from_file(tmp_path / name, (2, 2))
    imsave(tmp_path / "d.png", np.full((2, 2), 900, np.uint16), check_contrast=False)
    with pytest.raises(ValueError, match="has 2 x 2 pixels, the photo 5 x 4"):
        depth_from_file(tmp_path / "d.png", (4, 5))
