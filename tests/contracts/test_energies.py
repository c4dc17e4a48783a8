"""Every shipped energy and prior through one suite; a new one fails until `energy_parts` says how to build it."""

import pytest
import torch
from energy_parts import BUILD, NOT_ZERO, SIZE, allowed, asked, built, hard_pictures, pictures, weights
from torch.utils import _pytree as pytree
from walk import shipped

import kfit.energies
from kfit.core import Energy, Prior, ResidualEnergy
from kfit.energies import PSNR, LearnedScore


def values_of(prior, value, prepared):
    return prior(value) if prepared is None else prior(value, prepared)


def test_every_shipped_energy_and_prior_is_covered_here_and_exported():
    found = shipped(kfit.energies, Energy) | shipped(kfit.energies, Prior)
    assert found == set(BUILD) | {LearnedScore}  # whose network decides, see tests/energies/test_learned_score.py
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

    @pytest.mark.parametrize("along", ["any direction", pytest.param("each pixel", marks=pytest.mark.slow)])
    @pytest.mark.parametrize("weighted", [False, True], ids=["unweighted", "weighted"])
    def test_passes_gradcheck(self, build, weighted, along):
        energy = build().double()
        x, y = pictures(energy)
        prepared = energy.prepare(y, weights(energy) if weighted else None)
        fast = along == "any direction" or type(energy) in SIZE
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
        before = values_of(prior, value, prepared)
        assert before.shape == (3,)
        value, prepared = pytree.tree_map_only(torch.Tensor, lambda tensor: tensor[1:], (value, prepared))
        torch.testing.assert_close(values_of(prior, value, prepared), before[1:])

    def test_passes_gradcheck(self, build):
        prior = build().double()
        value, prepared = asked(prior, torch.float64)
        leaves, tree = pytree.tree_flatten(value)

        def energy(*leaves):
            return values_of(prior, pytree.tree_unflatten(list(leaves), tree), prepared)

        assert torch.autograd.gradcheck(energy, [leaf.requires_grad_() for leaf in leaves])

    @pytest.mark.parametrize("far", [0.0, torch.pi / 2, -torch.pi, 1e4])
    def test_is_finite_with_its_gradient_however_far_a_value_lies(self, build, far):
        prior = build()
        value, prepared = asked(prior)
        leaves, tree = pytree.tree_flatten(value)
        leaves = [allowed(prior, torch.full_like(leaf, far)).requires_grad_() for leaf in leaves]
        found = values_of(prior, pytree.tree_unflatten(leaves, tree), prepared)
        assert found.isfinite().all()
        slopes = torch.autograd.grad(found.sum(), leaves, materialize_grads=True)  # an upright head reads no roll
        assert all(slope.isfinite().all() for slope in slopes)
