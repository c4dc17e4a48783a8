"""The paper's generator without 3D: its sizes, its angles, and that it trains where VAE3D does."""

import math
from itertools import pairwise
from pathlib import Path

import pytest
import torch
from lightning.pytorch import LightningDataModule, LightningModule
from lightning.pytorch.cli import LightningCLI
from torch.utils.flop_counter import FlopCounterMode

from kfit.core import frozen
from kfit.energies import L1
from kfit.generators import VAE2D, VAE3D, ConvEncoder, ExtentsHead
from kfit.training import ConditionalVAE

RECIPE = Path(__file__).parents[2] / "recipes" / "smoke.yaml"


def multiply_adds(generator):
    with FlopCounterMode(display=False) as counter:
        frozen(generator)(code=torch.zeros(1, 16), azimuth=torch.zeros(1), elevation=torch.zeros(1))
    return counter.get_total_flops() / 2


def parameters(generator):
    return sum(p.numel() for p in generator.parameters())


def test_its_parameters_and_its_work_are_near_the_compact_vae3d_s():
    dims = (256, 256, 256, 128, 64)
    numbers = 16 * dims[0] + sum(16 * a * b + b for a, b in pairwise(dims)) + 9 * dims[-1] * 4 + 4
    numbers += sum((16 + 4 + 1) * 2 * dim for dim in dims)
    assert parameters(VAE2D()) == numbers == 2_799_940
    assert multiply_adds(VAE2D()) == pytest.approx(0.36e9, rel=0.02)
    assert 0.7 < multiply_adds(VAE2D()) / multiply_adds(VAE3D()) < 1
    assert 1 < parameters(VAE2D()) / parameters(VAE3D()) < 1.5


def test_takes_and_draws_what_vae3d_does():
    for depth in (False, True):
        flat, solid = VAE2D(depth=depth), VAE3D(depth=depth)
        assert flat.variables == solid.variables
        assert flat.image_size == solid.image_size
        values = {name: torch.zeros(2, *variable.shape) for name, variable in flat.variables.items()}
        for a, b in zip(vars(flat(**values)).values(), vars(solid(**values)).values(), strict=True):
            assert (a is None) == (b is None)
            assert a is None or a.shape == b.shape


@pytest.mark.parametrize("code_dim", [4, 16, 128])
def test_the_code_may_be_of_any_size(code_dim):
    generator = VAE2D(code_dim, (8, 8, 4))
    zero = torch.zeros(2)
    first, second = generator(code=torch.randn(2, code_dim), azimuth=zero, elevation=zero).image
    assert not torch.allclose(first, second)


def test_the_angles_change_the_picture_and_come_round():
    generator = VAE2D(4, (8, 8, 4)).double()
    code, zero = torch.randn(1, 4, dtype=torch.float64), torch.zeros(1, dtype=torch.float64)
    first = generator(code=code, azimuth=zero + 0.7, elevation=zero).image
    torch.testing.assert_close(generator(code=code, azimuth=zero + 0.7 - 2 * math.pi, elevation=zero).image, first)
    assert not torch.allclose(generator(code=code, azimuth=zero, elevation=zero).image, first)
    assert not torch.allclose(generator(code=code, azimuth=zero + 0.7, elevation=zero + 0.7).image, first)


# Lightning uses what jsonargparse deprecates.
@pytest.mark.filterwarnings("ignore")
def test_a_recipe_trains_it_without_kl_by_changing_one_class_path_and_one_number(monkeypatch):
    monkeypatch.setattr("sys.argv", ["lightning"])
    changes = ["--model.init_args.generator", "kfit.generators.VAE2D", "--model.init_args.kl_weight", "0"]
    cli = LightningCLI(
        LightningModule,
        LightningDataModule,
        subclass_mode_model=True,
        subclass_mode_data=True,
        run=False,
        args=["-c", str(RECIPE), *changes],
        save_config_callback=None,
    )
    assert type(cli.model.generator) is VAE2D
    assert cli.model.kl_weight == 0


def test_it_learns_as_a_conditional_vae_without_kl(monkeypatch):
    for name in ("log", "log_dict"):
        monkeypatch.setattr(ConditionalVAE, name, lambda *_, **__: None)
    module = ConditionalVAE(
        VAE2D(4, (8, 8, 4)), ConvEncoder(4, (8, 8), 8, 16), ExtentsHead(4, 8), {"image": L1()}, kl_weight=0.0
    )
    batch = {name: torch.rand(4, 3, 16, 16) for name in ("source", "target")}
    batch |= {"target_mask": torch.ones(4, 1, 16, 16), "azimuth": torch.rand(4), "elevation": torch.rand(4)}
    adam, losses = torch.optim.Adam(module.parameters(), 0.01), []
    for _ in range(30):
        adam.zero_grad()
        losses.append(module.training_step(batch, 0))
        losses[-1].backward()
        adam.step()
    assert losses[-1] < 0.9 * losses[0]
