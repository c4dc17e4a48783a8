import math

import numpy as np
import pytest
import torch

from kfit.geometry import Crop


def photo(height: int = 90, width: int = 120) -> torch.Tensor:
    """Background pure red, so that any of it that bleeds in shows."""
    image = torch.zeros(height, width, 3)
    image[..., 0] = 1
    return image


def box_mask(left: int, top: int, right: int, bottom: int, height: int = 90, width: int = 120) -> torch.Tensor:
    mask = torch.zeros(height, width)
    mask[top:bottom, left:right] = 1
    return mask


def test_the_square_is_centred_on_the_mask_and_a_third_larger() -> None:
    crop = Crop.around(box_mask(20, 30, 60, 50))
    assert crop.centre == (39.5, 39.5)
    assert crop.side == pytest.approx(1.3 * 40)


def test_the_two_transforms_undo_each_other() -> None:
    crop = Crop((33.3, 21.7), 87.1, 64)
    torch.testing.assert_close(crop.crop_to_image @ crop.image_to_crop, torch.eye(3, dtype=torch.float64))


def test_the_squares_edge_is_half_a_pixel_outside_the_pictures_centres() -> None:
    crop = Crop((50.0, 40.0), 32.0, 64)
    corner = crop.crop_to_image @ torch.tensor([-0.5, -0.5, 1], dtype=torch.float64)
    torch.testing.assert_close(corner, torch.tensor([34.0, 24, 1], dtype=torch.float64))


def test_a_crop_of_the_photos_own_size_copies_its_pixels() -> None:
    image = torch.rand(90, 120, 3)
    picture = Crop((51.5, 41.5), 64.0, 64).cut(image, torch.ones(90, 120)).image
    torch.testing.assert_close(picture[0], image[10:74, 20:84].movedim(-1, 0), atol=1e-4, rtol=0)


def test_an_even_shrinking_takes_the_mean_of_the_pixels_inside() -> None:
    image = torch.rand(64, 64, 3)
    picture = Crop((31.5, 31.5), 64.0, 16).cut(image, torch.ones(64, 64)).image
    expected = torch.nn.functional.avg_pool2d(image.movedim(-1, 0)[None], 4)
    torch.testing.assert_close(picture, expected, atol=1e-4, rtol=0)


def test_fine_stripes_shrink_to_grey() -> None:
    image = torch.zeros(640, 640, 3)
    image[:, ::2] = 1
    picture = Crop((319.5, 319.5), 450.0, 64).cut(image, torch.ones(640, 640)).image
    assert float((picture - 0.5).abs().max()) < 0.1


def test_a_very_large_crop_is_the_mean_of_what_each_pixel_spans() -> None:
    image = torch.rand(80, 80, 3, generator=torch.Generator().manual_seed(0)).repeat_interleave(10, 0)
    image = image.repeat_interleave(10, 1)
    picture = Crop((399.5, 399.5), 800.0, 16).cut(image, torch.ones(800, 800)).image
    expected = torch.nn.functional.avg_pool2d(image.movedim(-1, 0)[None], 50)
    # Blocks of 6 pixels do not divide 50: a little of the neighbours is mixed in.
    torch.testing.assert_close(picture[..., 1:-1, 1:-1], expected[..., 1:-1, 1:-1], atol=0.04, rtol=0)


def test_a_very_large_crop_lands_where_the_transform_says() -> None:
    x = torch.arange(3000.0).expand(1000, 3000) / 3000
    crop = Crop((1700.3, 480.8), 900.0, 64)
    picture = crop.cut(x[..., None].expand(-1, -1, 3), torch.ones(1000, 3000)).image
    columns = torch.stack((torch.arange(64.0), torch.zeros(64), torch.ones(64))).double()
    expected = (crop.crop_to_image @ columns)[0].float() / 3000
    torch.testing.assert_close(picture[0, 0, 32], expected, atol=1e-5, rtol=0)


def test_a_linear_ramp_lands_where_the_transform_says() -> None:
    x = torch.arange(120.0).expand(90, 120) / 120
    crop = Crop((60.2, 44.7), 40.0, 64)
    picture = crop.cut(x[..., None].expand(-1, -1, 3), torch.ones(90, 120)).image
    columns = torch.stack((torch.arange(64.0), torch.zeros(64), torch.ones(64))).double()
    expected = (crop.crop_to_image @ columns)[0].float() / 120
    torch.testing.assert_close(picture[0, 0, 20], expected, atol=1e-5, rtol=0)


def test_no_background_bleeds_into_the_object() -> None:
    image, mask = photo(), box_mask(31, 30, 72, 61)
    image[mask > 0] = torch.tensor([0.0, 1.0, 0.0])
    observed = Crop.around(mask, 48).cut(image, mask)
    assert observed.mask is not None
    expected = 1 - observed.mask * torch.tensor([1.0, 0, 1.0])[:, None, None]
    torch.testing.assert_close(observed.image, expected, atol=1e-5, rtol=0)


def test_the_mask_keeps_its_area_and_its_place() -> None:
    mask = box_mask(31, 30, 72, 61)
    crop = Crop.around(mask, 64)
    observed = crop.cut(photo(), mask)
    assert observed.mask is not None
    assert observed.mask.shape == (1, 1, 64, 64)
    assert float(observed.mask.sum()) * (crop.side / 64) ** 2 == pytest.approx(41 * 31, rel=0.03)
    columns = (observed.mask[0, 0].sum(0) * torch.arange(64.0)).sum() / observed.mask.sum()
    assert float(columns) == pytest.approx(31.5, abs=0.05)


def test_beyond_the_photos_border_the_ground_is_white_and_the_mask_empty() -> None:
    mask = box_mask(0, 0, 40, 90)
    observed = Crop.around(mask, 64).cut(photo(), mask)
    assert observed.mask is not None
    assert float(observed.mask[0, 0, :, 0].max()) == 0
    assert float(observed.image[0, :, :, 0].min()) == 1


def test_numpy_arrays_serve_as_well() -> None:
    mask = box_mask(31, 30, 72, 61)
    crop = Crop.around(mask.numpy() > 0)
    torch.testing.assert_close(crop.cut(photo().numpy(), mask.numpy()).image, crop.cut(photo(), mask).image)


def test_an_empty_mask_is_refused() -> None:
    with pytest.raises(ValueError, match="mask is empty: none of its 120 x 90 pixels is above 1/2"):
        Crop.around(torch.zeros(90, 120))


def test_a_mask_of_another_size_is_refused() -> None:
    with pytest.raises(ValueError, match=r"mask must have shape \(90, 120\), got \(90, 121\)"):
        Crop((0.0, 0.0), 10.0).cut(photo(), torch.ones(90, 121))


def test_an_image_of_bytes_is_refused() -> None:
    with pytest.raises(TypeError, match="image must be a floating-point tensor"):
        Crop((0.0, 0.0), 10.0).cut(photo().byte(), torch.ones(90, 120))


def test_a_side_need_not_be_whole() -> None:
    assert math.isclose(Crop.around(box_mask(10, 10, 21, 21)).side, 14.3)


def test_depth_is_the_mean_of_the_object_s_known_pixels_unknown_where_few():
    mask = np.zeros((40, 40), np.float32)
    mask[10:30, 10:30] = 1
    depth = np.full((40, 40), 9.0, np.float32)  # the ground behind, which must not bleed in
    depth[10:30, 10:30] = 2.0
    depth[14:22, 14:22] = 0  # unknown, as sensors write it
    depth[24, 24] = np.nan
    found = Crop((19.5, 19.5), 40.0, 20).cut(np.full((40, 40, 3), 0.5, np.float32), mask, depth).depth[0, 0]
    assert found.shape == (20, 20)
    known = found.isfinite()
    torch.testing.assert_close(found[known], torch.full((int(known.sum()),), 2.0))
    assert known[12, 12]
    assert not known[8:10, 8:10].any()
    assert not known[:4].any()
    assert int(known.sum()) == 100 - 16


def test_depth_of_another_shape_is_an_error():
    with pytest.raises(ValueError, match="depth must have shape"):
        Crop((1.5, 1.5), 4.0).cut(np.ones((4, 4, 3), np.float32), np.ones((4, 4)), np.ones((3, 4)))
