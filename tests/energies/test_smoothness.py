import kornia
import pytest
import torch

from kfit.energies import PSNR, BendingEnergy, Dice, TotalVariation, functional


def field(*shape):
    return torch.rand(shape, generator=torch.Generator().manual_seed(0), dtype=torch.float64)


def test_total_variation_is_kornias_mean_over_channels():
    flow = field(2, 3, 7, 9)
    expected = kornia.losses.total_variation(flow, reduction="mean").mean(1)
    torch.testing.assert_close(TotalVariation("flow")(flow), expected)


def test_total_variation_of_a_volume_counts_steps_along_each_axis():
    volume = torch.zeros(1, 1, 4, 4, 4)
    volume[:, :, 2:] = 1
    # 16 of 48 differences along the first axis are 1, none of the others
    torch.testing.assert_close(TotalVariation("volume")(volume), torch.tensor([1 / 3]))


class TestBendingEnergy:
    @pytest.mark.parametrize("size", [(6, 7), (5, 6, 4)])
    def test_of_an_affine_motion_is_zero(self, size):
        grid = torch.stack(torch.meshgrid(*(torch.arange(n).double() for n in size), indexing="ij"))
        linear = field(len(size), len(size))
        flow = torch.einsum("ij,j...->i...", linear, grid)[None] + 3
        assert BendingEnergy("flow")(flow).abs().max() < 1e-20

    def test_of_a_parabola_is_its_second_derivatives_squared(self):
        v, u = torch.meshgrid(torch.arange(6.0).double(), torch.arange(7.0).double(), indexing="ij")
        flow = (0.5 * 3 * v.square() + 2 * u * v - 0.5 * u.square())[None, None]
        # ∂vv = 3, ∂uu = −1, ∂uv = ∂vu = 2
        torch.testing.assert_close(BendingEnergy("flow")(flow), torch.tensor([9 + 1 + 2 * 4.0]).double())

    def test_of_a_volume_counts_six_second_derivatives(self):
        w, v, u = torch.meshgrid(*(torch.arange(5.0).double() for _ in range(3)), indexing="ij")
        flow = (w.square() + 3 * w * u + v * u)[None, None]
        torch.testing.assert_close(BendingEnergy("flow")(flow), torch.tensor([4 + 2 * 9 + 2 * 1.0]).double())

    def test_refuses_what_is_too_small_or_no_field(self):
        with pytest.raises(ValueError, match="flow must be at least 3 pixels along each side"):
            BendingEnergy("flow")(field(1, 2, 2, 5))
        with pytest.raises(ValueError, match=r"flow must have shape \(N, C, H, W\) or \(N, C, D, H, W\)"):
            BendingEnergy("flow")(field(4, 5, 5))


class TestDice:
    def test_of_hard_masks_is_the_overlap_twice_over_the_sum(self):
        a, b = torch.zeros(2, 1, 1, 4, 4)
        a[..., :3, :], b[..., 1:, :] = 1, 1
        torch.testing.assert_close(Dice()(a[None, :, 0], b[None, :, 0]), torch.tensor([1 - 2 * 8 / 24]))

    def test_of_two_empty_masks_is_zero_and_of_equal_soft_ones_too(self):
        soft = field(1, 1, 4, 4)
        assert Dice()(soft, soft) == 0
        assert Dice()(torch.zeros(1, 1, 4, 4), torch.zeros(1, 1, 4, 4)) == 0


class TestPSNR:
    def test_is_minus_kornias_for_each_row(self):
        x, y = field(2, 3, 3, 8, 8)
        for row in range(3):
            expected = -kornia.metrics.psnr(x[row], y[row], 1.0)
            torch.testing.assert_close(PSNR()(x, y)[row], expected, rtol=0, atol=1e-6)

    def test_ends_at_100_decibels(self):
        x = field(1, 3, 4, 4)
        torch.testing.assert_close(functional.psnr(x, x), torch.tensor([-100.0]).double())
