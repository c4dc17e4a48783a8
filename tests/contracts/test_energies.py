"""Every shipped energy and prior through one suite; a new one fails until the table below says how to build it."""

import importlib
import pkgutil

import pytest
import torch
from torch import nn
from torch.utils import _pytree as pytree

import kfit.energies
from kfit.core import Energy, Prior, ResidualEnergy
from kfit.energies import L1, L2, SSIM, CodePrior, Perceptual, Silhouette, SoftIoU


def features():
    torch.manual_seed(1)
    return nn.Sequential(nn.Conv2d(3, 4, 3, 2, 1), nn.Softplus(), nn.Conv2d(4, 3, 3, 1, 1))


BUILD = {
    L1: [L1],
    L2: [L2],
    SSIM: [SSIM],
    Perceptual: [lambda: Perceptual(features()), lambda: Perceptual(features(), squared=False)],
    Silhouette: [Silhouette],
    SoftIoU: [SoftIoU],
    CodePrior: [CodePrior],
}
CHANNELS = {"image": 3, "mask": 1}


def shipped(kind):
    for module in pkgutil.iter_modules(kfit.energies.__path__, "kfit.energies."):
        importlib.import_module(module.name)
    found, todo = [], [kind]
    while todo:
        todo += (subclasses := todo.pop().__subclasses__())
        found += [s for s in subclasses if s.__module__.startswith("kfit.energies.") and not s.__abstractmethods__]
    return sorted(set(found), key=lambda s: s.__name__)


def built(kind):
    return [
        pytest.param(build, id=f"{found.__name__}-{number}")
        for found in shipped(kind)
        for number, build in enumerate(BUILD.get(found, []))
    ]


def pictures(energy, rows=2, seed=0, dtype=torch.float64):
    rng = torch.Generator().manual_seed(seed)
    shape = (rows, CHANNELS[energy.on], 8, 8)
    return [0.1 + 0.8 * torch.rand(shape, generator=rng, dtype=dtype) for _ in range(2)]


def weights(rows=2, dtype=torch.float64):
    weight = torch.rand(rows, 1, 8, 8, generator=torch.Generator().manual_seed(5), dtype=dtype)
    weight[:, :, 2:5, 3:] = 0
    return weight


def test_every_shipped_energy_and_prior_is_covered_here_and_exported():
    found = set(shipped(Energy)) | set(shipped(Prior))
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

    def test_is_zero_at_the_truth_and_more_elsewhere(self, build):
        energy = build().double()
        x, y = pictures(energy)
        assert energy(y, y).abs().max() < 1e-12
        assert (energy(x, y) > 1e-4).all()
        assert (energy(0.9 * y + 0.1 * x, y) < energy(x, y)).all()

    @pytest.mark.parametrize("weight", [None, weights()], ids=["unweighted", "weighted"])
    def test_passes_gradcheck(self, build, weight):
        energy = build().double()
        x, y = pictures(energy)
        prepared = energy.prepare(y, weight)
        assert torch.autograd.gradcheck(lambda p: energy.compare(p, prepared), x.requires_grad_())

    @pytest.mark.parametrize("weight", [None, weights()], ids=["unweighted", "weighted"])
    def test_has_a_finite_gradient_at_the_truth(self, build, weight):
        energy = build().double()
        y = pictures(energy)[1]
        x = y.clone().requires_grad_()
        assert torch.autograd.grad(energy(x, y, weight).sum(), x)[0].isfinite().all()

    def test_keeps_rows_independent(self, build):
        energy = build().double()
        x, y = pictures(energy)
        before = energy(x, y, weights())
        x[0], y[0] = y[0].clone(), 0.3
        after = energy(x, y, weights())
        assert after[0] != before[0]
        torch.testing.assert_close(after[1], before[1])

    def test_prepares_rows_that_can_be_gathered(self, build):
        energy = build().double()
        x, y = pictures(energy)
        index = torch.tensor([1, 0, 1])
        for weight in (None, weights()):
            prepared = pytree.tree_map(lambda t: t.index_select(0, index), energy.prepare(y, weight))
            torch.testing.assert_close(energy.compare(x[index], prepared), energy(x, y, weight)[index])

    def test_counts_nothing_where_the_weight_is_zero(self, build):
        energy = build().double()
        x, y = pictures(energy)
        hidden = weights() == 0
        changed = [torch.where(hidden, other, picture) for picture, other in zip((x, y), (y, 1 - x), strict=True)]
        torch.testing.assert_close(energy(*changed, weights()), energy(x, y, weights()))
        x.requires_grad_()
        gradient = torch.autograd.grad(energy(x, y, weights()).sum(), x)[0]
        assert gradient[hidden.expand_as(x)].abs().max() == 0

    def test_with_all_weights_zero_is_zero_and_not_nan(self, build):
        energy = build().double()
        x, y = pictures(energy)
        weight = weights()
        weight[0] = 0
        found = energy(x.requires_grad_(), y, weight)
        assert found[0] == 0
        assert found[1] > 0
        assert torch.autograd.grad(found.sum(), x)[0].isfinite().all()

    def test_with_one_weight_everywhere_is_unweighted(self, build):
        energy = build().double()
        x, y = pictures(energy)
        torch.testing.assert_close(energy(x, y, torch.full((2, 1, 8, 8), 0.3).double()), energy(x, y))

    def test_refuses_a_weight_of_another_shape(self, build):
        energy = build().double()
        x, y = pictures(energy)
        with pytest.raises((ValueError, RuntimeError)):
            energy(x, y, torch.ones(3, 1, 8, 8).double())


@pytest.mark.parametrize("build", built(ResidualEnergy))
def test_residuals_square_and_sum_to_the_energy(build):
    energy = build().double()
    x, y = pictures(energy)
    for weight in (None, weights()):
        prepared = energy.prepare(y, weight)
        residuals = energy.residuals(x, prepared)
        assert residuals.dim() == 2
        torch.testing.assert_close(residuals.square().sum(1), energy.compare(x, prepared))


@pytest.mark.parametrize("build", built(Prior))
class TestAPrior:
    def test_gives_one_number_a_row_that_other_rows_do_not_move(self, build):
        prior, value = build(), torch.linspace(-1, 2, 12).view(3, 4)
        before = prior(value)
        assert before.shape == (3,)
        torch.testing.assert_close(prior(value[1:]), before[1:])

    def test_passes_gradcheck(self, build):
        value = torch.linspace(-1, 2, 12, dtype=torch.float64).view(3, 4).requires_grad_()
        assert torch.autograd.gradcheck(build(), value)
