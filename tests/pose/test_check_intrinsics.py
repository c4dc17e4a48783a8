import pytest
import torch

from kfit.pose.check_intrinsics import check_intrinsics


def checked(fx: float, fy: float, x: float, y: float, size: tuple[int, int] = (640, 480)) -> tuple[str, str]:
    """The notes and the warnings."""
    notes: list[str] = []
    warnings: list[str] = []
    check_intrinsics(torch.tensor([[fx, 0, x], [0, fy, y], [0, 0, 1]]).double(), *size, notes, warnings)
    return " ".join(notes), " ".join(warnings)


def test_a_cameras_own_intrinsics_pass_without_a_word() -> None:
    assert checked(591.0125, 590.16775, 322.525, 244.11084) == ("", "")  # of REAL275
    assert checked(1066.778, 1067.487, 312.9869, 241.3109) == ("", "")  # of YCB-Video


@pytest.mark.parametrize("fx", [100.0, 5900])
def test_focal_lengths_ten_times_apart_are_refused(fx: float) -> None:
    with pytest.raises(ValueError, match=f"of which none is twice the other, got {fx:g} and 590"):
        checked(fx, 590, 320, 240, (480, 640))


@pytest.mark.parametrize("x", [1e9, -1e9, 4000])
def test_a_principal_point_that_no_crop_has_is_refused(x: float) -> None:
    with pytest.raises(ValueError, match="must have their principal point near it"):
        checked(590, 590, x, 240)


@pytest.mark.parametrize(("times", "size"), [(0.5, "320 x 240"), (2, "1280 x 960"), (1.5, "960 x 720")])
def test_intrinsics_of_a_scaled_picture_are_doubted(times: float, size: str) -> None:
    notes, warnings = checked(590 * times, 590 * times, 320 * times - 0.5, 240 * times - 0.5)
    assert notes == ""
    assert f"is the middle of a picture of {size} pixels" in warnings


def test_a_principal_point_off_the_middle_is_reported() -> None:
    notes, warnings = checked(590, 590, 60, 240)
    assert "far from the photo's middle" in notes
    assert warnings == ""


def test_pixels_that_are_not_square_are_reported() -> None:
    notes, _ = checked(800, 590, 320, 240)
    assert "the focal lengths differ" in notes
