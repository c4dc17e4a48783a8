import pytest
import torch

from kfit.geometry import rotation_from_angles
from kfit.metrics import rotation_error_deg, scale_agnostic_translation_error, summary, translation_error_cm


def rotated(azimuth: float, elevation: float = 0.0) -> torch.Tensor:
    values = (torch.tensor(v, dtype=torch.float64) for v in (azimuth, elevation, 0.0))
    return rotation_from_angles(*values)


def test_a_quarter_turn_is_ninety_degrees() -> None:
    assert float(rotation_error_deg(rotated(torch.pi / 2), rotated(0))) == pytest.approx(90)


def test_a_bottle_turned_about_itself_has_no_error() -> None:
    assert float(rotation_error_deg(rotated(2, 0.1), rotated(0, 0.1), "y")) == pytest.approx(0, abs=1e-6)


def test_translation_errors_are_in_centimetres() -> None:
    error = translation_error_cm(torch.tensor([[0.03, 0.04, 1.0], [0, 0, 1]]), torch.tensor([0.0, 0, 1]))
    torch.testing.assert_close(error, torch.tensor([5.0, 0.0]))


def test_the_summary_counts_shares_and_takes_the_middle() -> None:
    found = summary(torch.tensor([1.0, 4.0, 8.0, 20.0, 50.0, 170.0]))
    assert found == {
        "median": pytest.approx(14),
        "under_5": pytest.approx(2 / 6),
        "under_10": pytest.approx(3 / 6),
        "under_30": pytest.approx(4 / 6),
        "under_60": pytest.approx(5 / 6),
    }


def test_a_failed_fit_counts_as_half_a_turn() -> None:
    found = summary(torch.tensor([float("nan"), 2.0, float("nan")]))
    assert found["median"] == 180
    assert found["under_5"] == pytest.approx(1 / 3)


def test_no_errors_at_all_are_refused() -> None:
    with pytest.raises(ValueError, match="at least one error, got none"):
        summary(torch.zeros(0))


def test_a_translation_free_of_scale_forgives_what_colour_cannot_tell() -> None:
    near, far = torch.tensor([0.0, 0.1, 1.0]), torch.tensor([0.0, 0.2, 2.0])
    half = torch.tensor(0.2), torch.tensor(0.1)
    assert float(scale_agnostic_translation_error(far, near, *half)) == pytest.approx(0, abs=1e-6)
    shifted = far + torch.tensor([0.02, 0.0, 0.0])
    assert float(scale_agnostic_translation_error(shifted, near, *half)) == pytest.approx(0.1, rel=1e-5)
