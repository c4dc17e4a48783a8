"""What every shipped energy takes, what it refuses in a sentence, and how it reduces."""

import pytest
import torch
from energy_parts import built, pictures, weights

from kfit.core import Energy


@pytest.mark.parametrize("build", built(Energy))
class TestAnEnergy:
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
