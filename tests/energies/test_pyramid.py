import pytest
import torch
from kornia.geometry.transform import build_pyramid, pyrdown
from torch import nn

from kfit.core import Energy
from kfit.energies import L1, L2, Depth, Pyramid, ResidualPyramid, Silhouette


def pictures(channels=3, size=16):
    rng = torch.Generator().manual_seed(0)
    return list(torch.rand(2, 2, channels, size, size, generator=rng, dtype=torch.float64))


def test_it_is_the_mean_over_the_levels_of_kornias_pyramid():
    x, y = pictures()
    levels = zip(*(build_pyramid(picture, 3) for picture in (x, y)), strict=True)
    torch.testing.assert_close(Pyramid(L2(), 3)(x, y), sum(L2()(*level) for level in levels) / 3)
    torch.testing.assert_close(Pyramid(L2(), 1)(x, y), L2()(x, y))


def test_with_weights_a_coarse_pixel_is_the_mean_of_those_that_count():
    x, y = torch.zeros(1, 1, 8, 8), torch.full((1, 1, 8, 8), 0.4)
    weight = torch.ones(1, 1, 8, 8)
    weight[..., 3:] = 0
    # a coarse pixel sees nothing of what is hidden, whatever stands there
    for hidden in (0.9, torch.nan):
        observed = torch.where(weight > 0, y, hidden)
        for energy in (L1(), Depth()):
            torch.testing.assert_close(Pyramid(energy, 2)(x, observed, weight), torch.tensor([0.4]))
    y[..., :2] = 0.8
    half = (pyrdown(y * weight) / pyrdown(weight).clamp_min(1e-6)) * (pyrdown(weight) > 0)
    expected = (L1()(x, y, weight) + L1()(pyrdown(x), half, pyrdown(weight))) / 2
    torch.testing.assert_close(Pyramid(L1(), 2)(x, y, weight), expected)


def test_it_stands_on_what_its_energy_stands_on():
    assert Pyramid(Silhouette()).on == "mask"
    x, y = pictures(1)
    torch.testing.assert_close(Pyramid(Silhouette())(x, y), Pyramid(L2())(x, y))


def test_of_squares_it_is_a_sum_of_squares():
    x, y = pictures()
    energy = ResidualPyramid(L2(), 3)
    torch.testing.assert_close(energy(x, y), Pyramid(L2(), 3)(x, y))
    residuals = energy.residuals(x, energy.prepare(y))
    assert residuals.shape == (2, 3 * (16**2 + 8**2 + 4**2))
    torch.testing.assert_close(residuals.square().sum(1), energy(x, y))


class Both(Energy):
    on = ("image", "mask")

    def compare(self, prediction, prepared):
        shares = prepared["target"]
        return sum((prediction[name] - shares[name]).abs().mean((1, 2, 3)) for name in shares)


@pytest.mark.parametrize("weighted", [False, True])
def test_an_energy_on_several_fields_has_each_halved(weighted):
    x, y = pictures(3)
    masks = pictures(1)
    weight = torch.full((2, 1, 16, 16), 0.5).double() if weighted else None
    energy = Pyramid(Both(), 2)
    assert energy.on == ("image", "mask")
    found = energy({"image": x, "mask": masks[0]}, {"image": y, "mask": masks[1]}, weight)
    torch.testing.assert_close(found, Pyramid(L1(), 2)(x, y) + Pyramid(L1(), 2)(*masks))


def test_it_pulls_from_afar_where_fine_pixels_see_nothing():
    # two dots, several pixels apart: alone, a dot's pixels pull only where the other's are
    dot = torch.zeros(1, 1, 16, 16).double()
    dot[..., 6:8, 4:6] = 1
    near, far = dot.roll(2, 3), dot.roll(6, 3)
    assert L2()(near, dot) == L2()(far, dot)
    assert Pyramid(L2(), 4)(near, dot) < Pyramid(L2(), 4)(far, dot)


def test_its_target_is_prepared_once_a_level():
    class Counting(L1):
        calls = 0

        def prepare(self, target, weight=None):
            Counting.calls += 1
            return super().prepare(target, weight)

    energy = Pyramid(Counting(), 3)
    x, y = pictures()
    prepared = energy.prepare(y)
    for _ in range(3):
        energy.compare(x, prepared)
    assert Counting.calls == 3


def test_the_networks_of_its_energy_are_its_own():
    network = nn.Conv2d(3, 4, 3)

    class Convolved(L1):
        def __init__(self):
            super().__init__()
            self.network = network

    assert len(list(Pyramid(Convolved()).parameters())) == 2


def test_levels_that_do_not_exist_are_refused():
    with pytest.raises(ValueError, match="num_levels must be at least 1"):
        Pyramid(L1(), 0)
    with pytest.raises(ValueError, match=r"num_levels is too large: a level of \(2, 2\) pixels has no half"):
        Pyramid(L1(), 6).prepare(pictures()[0])
