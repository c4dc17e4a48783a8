"""Every shipped energy and prior through one suite; a new one fails until the table below says how to build it."""

import copy
import functools
import tempfile
from pathlib import Path

import pytest
import torch
from torch import nn
from torch.utils import _pytree as pytree
from walk import shipped

import kfit.energies
from kfit.core import Energy, Observation, Prior, ResidualEnergy
from kfit.energies import (
    L1,
    L2,
    LPIPS,
    MSSSIM,
    NCC,
    PSNR,
    SSIM,
    BendingEnergy,
    Cauchy,
    Charbonnier,
    CodePrior,
    Depth,
    Dice,
    GemanMcClure,
    Gradient,
    Huber,
    LocalNCC,
    MutualInformation,
    Perceptual,
    PosePrior,
    Pyramid,
    ResidualPyramid,
    Silhouette,
    SoftIoU,
    TotalVariation,
    Welsch,
)
from kfit.features import Activations
from kfit.generators import PoseHead


def features():
    torch.manual_seed(1)
    return nn.Sequential(nn.Conv2d(3, 4, 3, 2, 1), nn.Softplus(), nn.Conv2d(4, 3, 3, 1, 1))


@functools.cache
def lpips():
    """LPIPS on an AlexNet of random weights."""
    torch.manual_seed(1)
    state = {}
    for number, channels, width, kernel in ((0, 3, 64, 11), (3, 64, 192, 5), (6, 192, 384, 3), (8, 384, 256, 3)):
        state[f"features.{number}.weight"] = torch.randn(width, channels, kernel, kernel) / (channels**0.5 * kernel)
        state[f"features.{number}.bias"] = 0.1 * torch.randn(width)
    state["features.10.weight"] = torch.randn(256, 256, 3, 3) / 48
    state["features.10.bias"] = 0.1 * torch.randn(256)
    with tempfile.TemporaryDirectory() as folder:
        torch.save(state, Path(folder) / "alexnet.pth")
        return LPIPS(weights=str(Path(folder) / "alexnet.pth"))


BUILD = {
    L1: [L1],
    L2: [L2],
    Charbonnier: [Charbonnier],
    Huber: [Huber, lambda: Huber(scale=10)],
    Cauchy: [Cauchy],
    GemanMcClure: [GemanMcClure],
    Welsch: [lambda: Welsch(scale=0.5)],
    SSIM: [SSIM],
    MSSSIM: [lambda: MSSSIM(num_scales=2, window_size=3), lambda: MSSSIM(window_size=5)],
    Gradient: [Gradient],
    NCC: [NCC],
    LocalNCC: [lambda: LocalNCC(5), LocalNCC],
    MutualInformation: [lambda: MutualInformation(num_bins=8)],
    Pyramid: [lambda: Pyramid(L1()), lambda: Pyramid(SoftIoU(), 2), lambda: Pyramid(Perceptual(features()), 2)],
    ResidualPyramid: [lambda: ResidualPyramid(L2()), lambda: ResidualPyramid(Cauchy(), 2)],
    Perceptual: [
        lambda: Perceptual(features()),
        lambda: Perceptual(features(), squared=False),
        lambda: Perceptual(Activations(features(), ["0", "2"])),
    ],
    LPIPS: [lambda: copy.deepcopy(lpips())],
    Silhouette: [Silhouette],
    SoftIoU: [SoftIoU],
    Depth: [Depth],
    Dice: [Dice],
    PSNR: [PSNR],
    CodePrior: [CodePrior],
    TotalVariation: [lambda: TotalVariation("field")],
    BendingEnergy: [lambda: BendingEnergy("field")],
    PosePrior: [lambda: PosePrior(head()), lambda: PosePrior(head("y"))],
}
CHANNELS = {"image": 3, "mask": 1, "depth": 1}
# LPIPS needs pictures of 31 pixels; a soft histogram blurs even a picture against itself
SIZE = {LPIPS: 31}
NOT_ZERO = (MutualInformation, PSNR)


def built(kind):
    return [
        pytest.param(build, id=f"{found.__name__}-{number}")
        for found in sorted(shipped(kfit.energies, kind), key=lambda found: found.__name__)
        for number, build in enumerate(BUILD.get(found, []))
    ]


def pictures(energy, rows=2, seed=0, dtype=torch.float64):
    rng = torch.Generator().manual_seed(seed)
    size = SIZE.get(type(energy), 8)
    shape = (rows, CHANNELS[energy.on], size, size)
    return [0.1 + 0.8 * torch.rand(shape, generator=rng, dtype=dtype) for _ in range(2)]


def weights(energy, rows=2, dtype=torch.float64):
    size = SIZE.get(type(energy), 8)
    weight = torch.rand(rows, 1, size, size, generator=torch.Generator().manual_seed(5), dtype=dtype)
    weight[:, :, size // 4 : 5 * size // 8, 3 * size // 8 :] = 0
    return weight


def hard_pictures(energy, dtype):
    """White, black, grey, one dark pixel, any, two that differ from these by a rounding, and two out of range."""
    anything = pictures(energy, rows=1, dtype=dtype)[0]
    plain = [torch.full_like(anything, tone) for tone in (1.0, 0.0, 0.5)]
    point = plain[0].clone()
    point[..., 3, 3] = 0
    return torch.cat([*plain, point, anything, plain[2] + 1e-7, anything + 1e-6, 1e4 * anything, -anything])


def head(symmetry="none"):
    torch.manual_seed(3)
    return PoseHead(symmetry, channels=(4, 4), hidden_dim=8, image_size=8)


def asked(prior, dtype=torch.float32):
    """Values of a prior's variables for three rows, and what it has read off their pictures."""
    shape = (2, 4, 4) if prior.on == "field" else (4,)
    rng = torch.Generator().manual_seed(1)
    angles = torch.linspace(-1, 2, 3, dtype=dtype)
    if isinstance(prior.on, str):
        value = 3 * torch.rand(3, *shape, generator=rng, dtype=dtype) - 1
    else:
        value = {name: angles / (i + 1) for i, name in enumerate(prior.on)}
    rng = torch.Generator().manual_seed(0)
    return value, prior.prepare(Observation(torch.rand(3, 3, 8, 8, generator=rng, dtype=dtype)))


def told(prior, value, prepared):
    return prior(value) if prepared is None else prior(value, prepared)


def test_every_shipped_energy_and_prior_is_covered_here_and_exported():
    found = shipped(kfit.energies, Energy) | shipped(kfit.energies, Prior)
    assert found == set(BUILD)
    assert {kind.__name__ for kind in found} <= set(kfit.energies.__all__)


@pytest.mark.parametrize("build", built(Energy))
class TestAnEnergy:
    def test_gives_one_number_a_row_and_the_same_in_both_ways_of_calling(self, build):
        energy = build()
        x, y = pictures(energy, rows=3, dtype=torch.float32)
        found = energy(x, y)
        assert found.shape == (3,)
        assert found.dtype == torch.float32
        torch.testing.assert_close(found, energy.compare(x, energy.prepare(y)))

    def test_is_least_at_the_truth_and_there_zero(self, build):
        energy = build().double()
        x, y = pictures(energy)
        least = energy(y, y)
        if not isinstance(energy, NOT_ZERO):
            assert least.abs().max() < 1e-12
        assert (energy(x, y) > least + 1e-4).all()
        assert (energy(0.9 * y + 0.1 * x, y) < energy(x, y)).all()

    @pytest.mark.parametrize("weighted", [False, True], ids=["unweighted", "weighted"])
    def test_passes_gradcheck(self, build, weighted):
        energy = build().double()
        x, y = pictures(energy)
        prepared = energy.prepare(y, weights(energy) if weighted else None)
        fast = type(energy) in SIZE
        assert torch.autograd.gradcheck(lambda p: energy.compare(p, prepared), x.requires_grad_(), fast_mode=fast)

    @pytest.mark.parametrize("weighted", [False, True], ids=["unweighted", "weighted"])
    def test_has_a_finite_gradient_at_the_truth(self, build, weighted):
        energy = build().double()
        y = pictures(energy)[1]
        x = y.clone().requires_grad_()
        assert torch.autograd.grad(energy(x, y, weights(energy) if weighted else None).sum(), x)[0].isfinite().all()

    @pytest.mark.parametrize("weighted", [False, True], ids=["unweighted", "weighted"])
    def test_passes_gradcheck_for_the_target_too(self, build, weighted):
        energy = build().double()
        pair = [picture.requires_grad_() for picture in pictures(energy)]
        weight = weights(energy) if weighted else None
        assert torch.autograd.gradcheck(lambda x, y: energy(x, y, weight), pair, fast_mode=True)

    @pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
    def test_is_finite_with_its_gradient_wherever_pictures_tell_nothing(self, build, dtype):
        energy = build().to(dtype)
        x = hard_pictures(energy, dtype)
        targets = len(x) - 2 if energy.unit_range else len(x)
        first, second = torch.cartesian_prod(torch.arange(len(x)), torch.arange(targets)).T
        empty = torch.zeros_like(x[first][:, :1])
        point = empty.index_fill(2, torch.tensor([3]), 1.0)
        for weight in (None, empty, point, torch.full_like(empty, 1e-30)):
            prediction = x[first].requires_grad_()
            found = energy(prediction, x[second], weight)
            assert found.isfinite().all()
            assert found.min() > (-100.1 if isinstance(energy, PSNR) else -1e-3)
            assert torch.autograd.grad(found.sum(), prediction)[0].isfinite().all()

    def test_in_bfloat16_is_still_summed_in_single_precision(self, build):
        energy = build()
        x, y = pictures(energy, dtype=torch.float32)
        with torch.autocast("cpu", torch.bfloat16):
            found = energy(x.bfloat16(), y)
        assert found.dtype == torch.float32
        torch.testing.assert_close(found, energy(x, y), rtol=0.05, atol=1e-3)

    def test_keeps_rows_independent(self, build):
        energy = build().double()
        x, y = pictures(energy)
        before = energy(x, y, weights(energy))
        x[0], y[0] = y[0].clone(), 0.3
        after = energy(x, y, weights(energy))
        assert after[0] != before[0]
        torch.testing.assert_close(after[1], before[1])

    def test_tells_of_a_row_that_is_not_a_number_and_spares_the_others(self, build):
        energy = build().double()
        x, y = pictures(energy)
        expected = energy(x, y)[1]
        x[0, 0, 1, 1] = torch.nan
        found = energy(x, y)
        assert not found[0].isfinite()
        torch.testing.assert_close(found[1], expected)

    def test_prepares_rows_that_can_be_gathered(self, build):
        energy = build().double()
        x, y = pictures(energy)
        index = torch.tensor([1, 0, 1])
        for weight in (None, weights(energy)):
            prepared = pytree.tree_map(lambda t: t.index_select(0, index), energy.prepare(y, weight))
            torch.testing.assert_close(energy.compare(x[index], prepared), energy(x, y, weight)[index])

    def test_counts_nothing_where_the_weight_is_zero(self, build):
        energy = build().double()
        x, y = pictures(energy)
        hidden = weights(energy) == 0
        changed = [torch.where(hidden, other, picture) for picture, other in zip((x, y), (y, 1 - x), strict=True)]
        torch.testing.assert_close(energy(*changed, weights(energy)), energy(x, y, weights(energy)))
        x.requires_grad_()
        gradient = torch.autograd.grad(energy(x, y, weights(energy)).sum(), x)[0]
        assert gradient[hidden.expand_as(x)].abs().max() == 0

    @pytest.mark.parametrize("value", [torch.nan, torch.inf])
    def test_never_counts_what_is_not_a_number_where_the_weight_is_zero(self, build, value):
        energy = build().double()
        pair, weight = pictures(energy), weights(energy)
        expected = energy(*pair, weight)
        spoiled = [torch.where(weight == 0, value, picture).requires_grad_() for picture in pair]
        for x, y in (spoiled, (spoiled[0], pair[1]), (pair[0], spoiled[1])):
            found = energy(x, y, weight)
            torch.testing.assert_close(found, expected)
        prediction, target = torch.autograd.grad(energy(*spoiled, weight).sum(), spoiled)
        assert prediction.isfinite().all()
        assert target.isfinite().all()

    def test_passes_gradcheck_for_a_weight_that_is_drawn(self, build):
        energy = build().double()
        x, y = pictures(energy)
        hidden = weights(energy) == 0

        def compared(weight):
            return energy(x, y, torch.where(hidden, 0, weight))

        weight = weights(energy).clamp_min(0.1).requires_grad_()
        assert torch.autograd.gradcheck(compared, weight, fast_mode=True)

    def test_with_all_weights_zero_is_zero_and_not_nan(self, build):
        energy = build().double()
        x, y = pictures(energy)
        weight = weights(energy)
        weight[0] = 0
        found = energy(x.requires_grad_(), y, weight)
        assert found[0] == 0
        assert found[1] != 0
        assert torch.autograd.grad(found.sum(), x)[0].isfinite().all()

    def test_with_one_weight_everywhere_is_unweighted(self, build):
        energy = build().double()
        x, y = pictures(energy)
        torch.testing.assert_close(energy(x, y, torch.full_like(weights(energy), 0.3)), energy(x, y))

    def test_refuses_a_weight_of_another_shape_or_below_zero(self, build):
        energy = build().double()
        x, y = pictures(energy)
        size = y.shape[-1]
        with pytest.raises(ValueError, match=rf"weight must have shape \(2, 1, {size}, {size}\), got \(3, 1, 8, 8\)"):
            energy(x, y, torch.ones(3, 1, 8, 8).double())
        with pytest.raises(ValueError, match="weight must be at least 0 everywhere, got -1"):
            energy(x, y, weights(energy) - (weights(energy) == 0).double())

    def test_refuses_what_is_no_batch_of_pictures_in_one_sentence(self, build):
        energy = build()
        x, y = pictures(energy, dtype=torch.float32)
        with pytest.raises(ValueError, match=r"target must have shape \(N, C, H, W\).* got .*target\[None\]"):
            energy(x[0], y[0])
        with pytest.raises(ValueError, match=r"prediction must have shape \(N, C, H, W\).*prediction\[None\]"):
            energy(x[0], y)
        with pytest.raises(ValueError, match="target must hold at least one picture"):
            energy(x[:0], y[:0])
        with pytest.raises(TypeError, match=r"target must be a floating-point .*uint8: target.float\(\) / 255"):
            energy(x, (255 * y).byte())
        with pytest.raises(TypeError, match="prediction must be a floating-point"):
            energy((255 * x).byte(), y)
        with pytest.raises(TypeError, match="target must be a tensor"):
            energy(x, y.numpy())
        with pytest.raises(ValueError, match="prediction must have shape"):
            energy(x[..., :-1], y)
        if energy.unit_range:
            with pytest.raises(ValueError, match=r"target must lie in \[0, 1\], got .* to .*: divide it by 255"):
                energy(255 * x, 255 * y)

    def test_reduces_rows_where_asked(self, build):
        energy = build().double()
        x, y = pictures(energy)
        rows = energy(x, y)
        torch.testing.assert_close(energy(x, y, reduction="mean"), rows.mean())
        torch.testing.assert_close(energy(x, y, reduction="sum"), rows.sum())
        with pytest.raises(ValueError, match="reduction must be one of none, mean, sum, got 'max'"):
            energy(x, y, reduction="max")

    def test_compares_volumes_or_says_that_it_cannot(self, build):
        energy = build().double()
        x, y = (torch.stack([picture, picture.flip(0)], 2) for picture in pictures(energy))
        if not energy.volumes:
            with pytest.raises(ValueError, match=r"target must have shape \(N, C, H, W\), got"):
                energy(x, y)
            return
        x, y = (torch.cat([picture] * 4, 2) for picture in (x, y))
        weight = torch.stack([weights(energy)] * 8, 2)
        assert (energy(y, y, weight) < energy(x, y, weight)).all()
        hidden = torch.where(weight > 0, x, torch.nan)
        torch.testing.assert_close(energy(hidden, y, weight), energy(x, y, weight))
        torch.testing.assert_close(energy(x, y, torch.full_like(weight, 0.3)), energy(x, y))
        torch.testing.assert_close(energy(x.flip(2), y.flip(2)), energy(x, y))
        x.requires_grad_()
        assert torch.autograd.gradcheck(lambda p: energy(p, y, weight), x, fast_mode=True)

    def test_of_pictures_is_the_same_under_vmap(self, build):
        energy = build().double()
        x, y = pictures(energy, rows=4)
        mapped = torch.vmap(energy)(x.unflatten(0, (2, 2)), y.unflatten(0, (2, 2)))
        torch.testing.assert_close(mapped.flatten(), energy(x, y))

    def test_under_autocast_is_as_exact_as_without(self, build):
        energy = build()
        x, y = pictures(energy, dtype=torch.float32)
        x.requires_grad_()
        plain = energy(x, y)
        slope = torch.autograd.grad(plain.sum(), x)[0]
        with torch.autocast("cpu", torch.bfloat16):
            cast = energy(x, y)
            slope_cast = torch.autograd.grad(cast.sum(), x)[0]
        tolerance = {"rtol": 0.05, "atol": 1e-3} if energy.mixed else {"rtol": 0, "atol": 0}
        torch.testing.assert_close(cast, plain, **tolerance)
        if not energy.mixed:
            torch.testing.assert_close(slope_cast, slope, rtol=0, atol=0)


@pytest.mark.parametrize("build", built(ResidualEnergy))
def test_residuals_square_and_sum_to_the_energy(build):
    energy = build().double()
    x, y = pictures(energy)
    for weight in (None, weights(energy)):
        prepared = energy.prepare(y, weight)
        residuals = energy.residuals(x, prepared)
        assert residuals.dim() == 2
        torch.testing.assert_close(residuals.square().sum(1), energy.compare(x, prepared))


@pytest.mark.parametrize("build", built(Prior))
class TestAPrior:
    def test_gives_one_number_a_row_that_other_rows_do_not_move(self, build):
        prior = build()
        value, prepared = asked(prior)
        before = told(prior, value, prepared)
        assert before.shape == (3,)
        value, prepared = pytree.tree_map_only(torch.Tensor, lambda tensor: tensor[1:], (value, prepared))
        torch.testing.assert_close(told(prior, value, prepared), before[1:])

    def test_passes_gradcheck(self, build):
        prior = build().double()
        value, prepared = asked(prior, torch.float64)
        leaves, tree = pytree.tree_flatten(value)

        def energy(*leaves):
            return told(prior, pytree.tree_unflatten(list(leaves), tree), prepared)

        assert torch.autograd.gradcheck(energy, [leaf.requires_grad_() for leaf in leaves])

    @pytest.mark.parametrize("far", [0.0, torch.pi / 2, -torch.pi, 1e4])
    def test_is_finite_with_its_gradient_however_far_a_value_lies(self, build, far):
        prior = build()
        value, prepared = asked(prior)
        leaves, tree = pytree.tree_flatten(value)
        leaves = [torch.full_like(leaf, far).requires_grad_() for leaf in leaves]
        found = told(prior, pytree.tree_unflatten(leaves, tree), prepared)
        assert found.isfinite().all()
        assert all(slope.isfinite().all() for slope in torch.autograd.grad(found.sum(), leaves))
