"""Every space through one suite; a new one fails until the table below says how to build it."""

import math

import pytest
import torch

from kfit.core import SO3, Angle, Bounded, Positive, Real, Simplex, Space, UnitVector, Variable

# How to build it, values that it holds, and raw numbers with the values that they stand for, by hand.
CASES = {
    Real: (Real(), [-3.0, 0.0, 2.5], {-1.5: -1.5, 4.0: 4.0}),
    Positive: (Positive(), [1e-3, 1.0, 40.0], {0.0: 1.0, 2.0: 7.38905609893065}),
    Bounded: (Bounded(-1.0, 3.0), [-0.9, 0.0, 2.9], {0.0: 1.0, 1.0: 1.92423431452}),
    Angle: (Angle(), [-7.0, 0.0, math.pi], {0.5: math.pi / 2, -1.0: -math.pi, 3.0: 3 * math.pi}),
}


CURVED = {SO3, Simplex, UnitVector}  # in tests/core/test_manifolds.py


def shipped():
    return {kind for kind in Space.__subclasses__() if kind.__module__.startswith("kfit.")}


def test_every_shipped_space_is_covered_here():
    assert shipped() == set(CASES) | CURVED


@pytest.mark.parametrize("kind", CASES, ids=lambda kind: kind.__name__)
class TestASpace:
    def test_round_trips_in_any_shape(self, kind):
        space, values, _ = CASES[kind]
        values = torch.tensor(values, dtype=torch.float64).expand(2, 3)
        torch.testing.assert_close(space.to_value(space.to_raw(values)), values, rtol=1e-12, atol=1e-12)

    def test_means_what_its_formula_says(self, kind):
        space, _, known = CASES[kind]
        raw, values = (torch.tensor(list(numbers), dtype=torch.float64) for numbers in (known, known.values()))
        torch.testing.assert_close(space.to_value(raw), values, rtol=1e-11, atol=0)
        torch.testing.assert_close(space.to_raw(values), raw, rtol=1e-10, atol=1e-11)

    def test_has_gradients_both_ways(self, kind):
        space, values, _ = CASES[kind]
        values = torch.tensor(values, dtype=torch.float64, requires_grad=True)
        assert torch.autograd.gradcheck(space.to_raw, values)
        raw = space.to_raw(values).detach().requires_grad_()
        assert torch.autograd.gradcheck(space.to_value, raw)
        (slope,) = torch.autograd.grad(space.to_value(raw).sum(), raw)
        assert bool((slope > 0).all())

    def test_keeps_the_type_of_its_numbers(self, kind):
        space, values, _ = CASES[kind]
        for dtype in (torch.float32, torch.float64):
            raw = space.to_raw(torch.tensor(values, dtype=dtype))
            assert raw.dtype == space.to_value(raw).dtype == dtype


def test_raw_numbers_of_any_size_stay_within_the_range():
    raw = torch.linspace(-50, 50, 101, dtype=torch.float64)
    assert bool((Positive().to_value(raw) > 0).all())
    bounded = Bounded(-1.0, 3.0).to_value(raw)
    assert bounded.min() >= -1
    assert bounded.max() <= 3


def test_values_on_or_beyond_a_bound_start_a_thousandth_inside_it_with_a_slope():
    space = Bounded(-1.0, 3.0)
    raw = space.to_raw(torch.tensor([-1.0, -7.0, 3.0, 9.0])).requires_grad_()
    value = space.to_value(raw)
    torch.testing.assert_close(value, torch.tensor([-0.996, -0.996, 2.996, 2.996]))
    value.sum().backward()
    assert bool((raw.grad > 1e-3).all())


@pytest.mark.parametrize("value", [0.0, -2.0])
def test_a_positive_variable_refuses_what_is_not_above_zero(value):
    with pytest.raises(ValueError, match=f"Positive variable must be above 0, got {value:g}"):
        Positive().to_raw(torch.tensor([1.0, math.nan, value]))


def test_what_is_no_number_stays_so_in_its_own_row():
    for space in (Angle(), Bounded(-1.0, 1.0), Positive(), Real()):
        raw = space.to_raw(torch.tensor([0.5, math.nan, 0.25]))
        torch.testing.assert_close(space.to_value(raw), torch.tensor([0.5, math.nan, 0.25]), equal_nan=True)


@pytest.mark.parametrize("bounds", [(1.0, 1.0), (2.0, 1.0)])
def test_bounds_must_rise(bounds):
    with pytest.raises(ValueError, match="low < high"):
        Bounded(*bounds)


def test_angles_are_not_wrapped():
    assert Angle().to_value(torch.tensor(2.5)).item() == pytest.approx(2.5 * math.pi)


def test_a_variable_is_a_real_number_by_default():
    assert Variable() == Variable((), Real())
