import jsonargparse
import pytest
import torch

from kfit.core import Energy
from kfit.energies import L2, Cauchy, Charbonnier, GemanMcClure, Huber, Welsch

KERNELS = [Charbonnier, Huber, Cauchy, GemanMcClure, Welsch]
CLOSED_FORMS = [
    (Charbonnier, lambda u: (u.square() + 1).sqrt() - 1),
    (Huber, lambda u: torch.where(u.abs() <= 1, u.square() / 2, u.abs() - 0.5)),
    (Cauchy, lambda u: (1 + u.square() / 2).log()),
    (GemanMcClure, lambda u: 2 * u.square() / (u.square() + 4)),
    (Welsch, lambda u: 1 - (-u.square() / 2).exp()),
]


def at(difference):
    """One pixel of a picture, and another that differs by so much."""
    difference = torch.as_tensor(difference, dtype=torch.float64).view(-1, 1, 1, 1)
    return 0.5 + difference, torch.full_like(difference, 0.5)


@pytest.mark.parametrize(("kind", "kernel"), CLOSED_FORMS)
def test_each_is_its_closed_form_of_the_difference_over_the_scale(kind, kernel):
    difference = torch.tensor([-0.9, -0.2, -1e-3, -1e-7, 0, 1e-6, 3e-5, 0.05, 0.2, 0.4, 3], dtype=torch.float64)
    torch.testing.assert_close(kind(scale=0.2)(*at(difference)), kernel(difference / 0.2), rtol=1e-6, atol=1e-15)


@pytest.mark.parametrize("kind", KERNELS)
def test_each_is_half_the_square_over_the_scale_where_differences_are_small(kind):
    rng = torch.Generator().manual_seed(0)
    x = torch.rand(2, 3, 6, 6, generator=rng, dtype=torch.float64)
    y = x + 1e-3 * torch.rand(2, 3, 6, 6, generator=rng, dtype=torch.float64)
    torch.testing.assert_close(kind(scale=0.5)(x, y), L2()(x, y) / 2 / 0.5**2, rtol=1e-5, atol=0)


@pytest.mark.parametrize("kind", KERNELS)
def test_the_slope_passes_through_zero_without_a_jump(kind):
    for dtype, rtol in ((torch.float64, 1e-6), (torch.float32, 1e-4)):
        x, y = (picture.to(dtype) for picture in at([-1e-4, -1e-6, 0, 1e-6, 0.9e-5, 1.1e-5, 1e-4]))
        x.requires_grad_()
        slope = torch.autograd.grad(kind(scale=0.1)(x, y).sum(), x)[0]
        torch.testing.assert_close(slope, (x - y).detach() / 0.1**2, rtol=rtol, atol=1e-6)


def test_a_wrong_pixel_pulls_less_the_further_the_kernel_levels_off():
    slopes = []
    for kind in (Huber, Charbonnier, Cauchy, GemanMcClure, Welsch):
        x, y = at([0.6])
        slopes.append(torch.autograd.grad(kind(scale=0.1)(x.requires_grad_(), y).sum(), x)[0].item())
    assert slopes == sorted(slopes, reverse=True)
    assert slopes[-1] < 1e-5


def test_a_weight_makes_it_a_weighted_mean_over_pixels():
    x = torch.tensor([[[[0.6, 0.5]]]])
    found = Cauchy(scale=0.1)(x, torch.full_like(x, 0.5), torch.tensor([[[[3.0, 1.0]]]]))
    torch.testing.assert_close(found, 0.75 * torch.tensor([1.5]).log())


@pytest.mark.parametrize("scale", [0.0, -1.0, float("nan")])
@pytest.mark.parametrize("kind", KERNELS)
def test_a_scale_that_is_not_above_zero_is_refused(kind, scale):
    with pytest.raises(ValueError, match="scale must be above 0"):
        kind(scale)


def test_pictures_of_different_shapes_are_refused_instead_of_broadcast():
    with pytest.raises(ValueError, match="prediction must have shape"):
        Huber()(torch.rand(1, 1, 4, 4), torch.rand(1, 3, 4, 4))


def test_a_recipe_builds_one_inside_another():
    parser = jsonargparse.ArgumentParser()
    parser.add_argument("--energies", type=dict[str, Energy])
    recipe = """
    energies:
      image:
        class_path: kfit.energies.Pyramid
        init_args:
          energy: {class_path: kfit.energies.Cauchy, init_args: {scale: 0.05}}
          num_levels: 2
    """
    energies = parser.instantiate(parser.parse_string(recipe)).energies
    assert energies["image"].energy.scale == 0.05
