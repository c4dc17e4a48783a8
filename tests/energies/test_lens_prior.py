import math

import pytest
import torch

from kfit.core import Observation
from kfit.energies import LensPrior
from kfit.geometry import distance_by_focal

CAMERA = torch.diag(torch.tensor([24.0, 24.0, 1.0]))[None]  # three widths of the picture


def prior(focal, scale=1.0, diagonal=0.2):
    lens = LensPrior(diagonal, 0.8)
    prepared = lens.prepare(Observation(torch.ones(1, 3, 8, 8), intrinsics=CAMERA))
    return float(lens({"focal": torch.tensor([focal]), "scale": torch.tensor([scale])}, prepared))


def test_it_is_half_of_the_squares_of_both_deviations_of_logarithms():
    away = 0.2 * float(distance_by_focal(torch.tensor(4.0 / 1.5), 0.8))
    expected = (math.log(4 / 3) / 0.4) ** 2 / 2 + (math.log(away / 0.63) / 0.58) ** 2 / 2
    assert prior(4.0, 1.5) == pytest.approx(expected, rel=1e-5)


def test_a_short_lens_is_unlikely_where_it_would_have_the_object_at_the_nose():
    # At three widths an object that fills the picture is 0.76 m away, one of a fourth of that size 0.19 m.
    assert prior(3.0) < 0.1
    assert prior(4.0, diagonal=0.05) < prior(3.0, diagonal=0.05) < prior(2.0, diagonal=0.05)


def test_a_picture_of_no_camera_at_all_is_an_error():
    with pytest.raises(ValueError, match="observation has no 'intrinsics'"):
        LensPrior(0.2, 0.8).prepare(Observation(torch.ones(1, 3, 8, 8)))
    with pytest.raises(ValueError, match="LensPrior: diagonal"):
        LensPrior(0.0, 0.8)
