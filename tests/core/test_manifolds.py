"""Curved spaces: their maps, their steps, and fits in them by every optimizer."""

import math

import pytest
import torch
from scipy.spatial.transform import Rotation

from kfit import FitPipeline
from kfit.core import SO3, Generator, Observation, Rendering, Simplex, UnitVector, Variable
from kfit.energies import L2
from kfit.initializers import Constant
from kfit.optimizers import (
    CMAES,
    LBFGS,
    Adam,
    AutoAdam,
    GaussNewton,
    LevenbergMarquardt,
    Stages,
    TorchOptimizer,
)

SHAPES = {SO3: (3, 3), UnitVector: (4,), Simplex: (4,)}


def raw_numbers(kind, rows=6):
    shape = kind().raw_shape(SHAPES[kind])
    return torch.randn(rows, *shape, generator=torch.Generator().manual_seed(1), dtype=torch.float64) / 2


@pytest.mark.parametrize("kind", SHAPES, ids=lambda kind: kind.__name__)
class TestACurvedSpace:
    def test_gives_values_that_come_back(self, kind):
        value = kind().to_value(raw_numbers(kind))
        assert value.shape[1:] == SHAPES[kind]
        torch.testing.assert_close(kind().to_value(kind().to_raw(value)), value, rtol=0, atol=1e-12)

    def test_does_not_move_by_a_step_of_zero(self, kind):
        space, raw = kind(), raw_numbers(kind)
        same = space.to_value(space.retract(raw, torch.zeros_like(raw)))
        torch.testing.assert_close(same, space.to_value(raw), rtol=0, atol=1e-12)

    def test_has_first_and_second_derivatives_by_a_step(self, kind):
        space = kind()
        for raw in (
            raw_numbers(kind),
            torch.eye(4, dtype=torch.float64)[: 1 + (kind is not SO3)][:, : 3 if kind is SO3 else 4],
        ):
            step = torch.zeros_like(raw, requires_grad=True)

            def value(step, raw=raw):
                return space.to_value(space.retract(raw, step))

            assert torch.autograd.gradcheck(value, step)
            assert torch.autograd.gradgradcheck(value, step)

    def test_leaves_what_is_no_number_in_its_own_row(self, kind):
        raw = raw_numbers(kind)
        raw[2] = math.nan
        value = kind().to_value(kind().retract(raw, 0.1 * torch.ones_like(raw)))
        assert value.flatten(1).isnan().any(1).tolist() == [row == 2 for row in range(6)]
        assert kind().to_raw(value).flatten(1).isnan().any(1).tolist() == [row == 2 for row in range(6)]

    def test_keeps_the_type_of_its_numbers(self, kind):
        for dtype in (torch.float32, torch.float64):
            raw = raw_numbers(kind).to(dtype)
            assert (
                kind().to_value(raw).dtype
                == kind().retract(raw, raw).dtype
                == kind().to_raw(kind().to_value(raw)).dtype
                == dtype
            )


class TestSO3:
    def test_means_what_scipy_s_rotation_vectors_mean(self):
        raw = raw_numbers(SO3)
        theirs = torch.from_numpy(Rotation.from_rotvec(math.pi * raw.numpy()).as_matrix())
        torch.testing.assert_close(SO3().to_value(raw), theirs, rtol=0, atol=1e-12)

    @pytest.mark.parametrize("size", [0.0, 1e-9, 1e-3, 0.5, 1 - 1e-9, 1.0])
    def test_finds_rotation_vectors_of_any_angle(self, size):
        axis = torch.nn.functional.normalize(raw_numbers(SO3), dim=1)
        matrix = SO3().to_value(size * axis)
        raw = SO3().to_raw(matrix)
        assert raw.norm(dim=1).max() <= 1 + 1e-12
        torch.testing.assert_close(SO3().to_value(raw), matrix, rtol=0, atol=1e-12)
        torch.testing.assert_close(raw.norm(dim=1), torch.full((6,), size, dtype=torch.float64), rtol=0, atol=1e-8)

    def test_a_step_turns_about_the_object_s_own_axes(self):
        raw, step = raw_numbers(SO3), raw_numbers(SO3).flip(0)
        expected = SO3().to_value(raw) @ SO3().to_value(step)
        torch.testing.assert_close(SO3().to_value(SO3().retract(raw, step)), expected, rtol=0, atol=1e-12)

    def test_many_steps_never_leave_the_rotations(self):
        raw, step = raw_numbers(SO3).float(), 0.3 * raw_numbers(SO3).flip(0).float()
        for _ in range(200):
            raw = SO3().retract(raw, step)
        value = SO3().to_value(raw)
        torch.testing.assert_close(value @ value.mT, torch.eye(3).expand(6, 3, 3), rtol=0, atol=1e-5)
        assert raw.norm(dim=1).max() <= 1 + 1e-6

    def test_refuses_what_is_no_rotation(self):
        for matrix in (2 * torch.eye(3), -torch.eye(3), torch.ones(3, 3)):
            with pytest.raises(ValueError, match="SO3 variable must hold rotation matrices"):
                SO3().to_raw(matrix)


def test_a_unit_vector_s_step_follows_the_great_circle():
    east, north = torch.tensor([1.0, 0.0, 0.0]), torch.tensor([5.0, math.pi / 6, 0.0])
    moved = UnitVector().retract(east, north)  # what points outwards does not count
    torch.testing.assert_close(moved, torch.tensor([math.cos(math.pi / 6), 0.5, 0.0]))


def test_shares_are_above_zero_and_sum_to_one():
    value = Simplex().to_value(10 * raw_numbers(Simplex))
    assert bool((value > 0).all())
    torch.testing.assert_close(value.sum(1), torch.ones(6, dtype=torch.float64))
    with pytest.raises(ValueError, match="sum to 1"):
        Simplex().to_raw(torch.tensor([0.5, 0.6]))


@pytest.mark.parametrize(
    ("space", "shape"), [(SO3(), (3,)), (SO3(), ()), (UnitVector(), ()), (UnitVector(), (1,)), (Simplex(), (1,))]
)
def test_a_variable_of_an_impossible_shape_is_refused(space, shape):
    with pytest.raises(ValueError, match=f"a variable in {type(space).__name__} must"):
        Variable(shape, space)


class Rotated(Generator):
    """Draws where a rotation takes three points, as an image of one row."""

    variables = {"rotation": Variable((3, 3), SO3()), "direction": Variable((3,), UnitVector())}  # noqa: RUF012

    def forward(self, **values):
        return Rendering(torch.cat([values["rotation"], values["direction"][:, None]], 1)[:, None])


OPTIMIZERS = {
    "Adam": (Adam(0.03, betas=(0.9, 0.99)), 250),
    "AutoAdam": (AutoAdam(0.03, betas=(0.9, 0.99)), 250),
    "torch": (TorchOptimizer(torch.optim.NAdam, lr=0.05), 250),
    "LBFGS": (LBFGS(first_step=0.1), 25),
    "LevenbergMarquardt": (LevenbergMarquardt(), 12),
    "GaussNewton": (GaussNewton({"rotation": 1e-4, "direction": 1e-4}, reach=3000), 20),
    "CMAES": (CMAES(0.2), 60),
    "Stages": (Stages([(Adam(0.05), 20), (LevenbergMarquardt(), 5)]), 30),
}


LONG = ("AutoAdam", "torch")  # which walk as Adam does


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow) if name in LONG else name for name in OPTIMIZERS]
)
def test_every_optimizer_finds_a_rotation_and_a_direction(name):
    optimizer, steps = OPTIMIZERS[name]
    rotation = SO3().to_value(torch.tensor([[0.5, -0.4, 0.6]], dtype=torch.float64))  # 158° from the start
    direction = torch.tensor([[-0.6, 0.0, 0.8]], dtype=torch.float64)
    observed = Rotated()(rotation=rotation, direction=direction).image
    starts = [Constant({"rotation": torch.eye(3).tolist(), "direction": [1.0, 0.0, 0.0]})]
    pipeline = FitPipeline(Rotated(), {"l2": L2()}, starts, optimizer, num_starts=1, num_steps=steps)
    found = pipeline(Observation(observed), seed=0)
    torch.testing.assert_close(found.values["rotation"], rotation, rtol=0, atol=0.02)
    torch.testing.assert_close(found.values["direction"], direction, rtol=0, atol=0.02)
