"""What a trained generator draws, apart from any fit: how exactly, how costly, and what its prior looks like."""

from __future__ import annotations

import math
from pathlib import Path

import torch
from torch import Tensor
from torch.utils.flop_counter import FlopCounterMode

from kfit.core import Generator, frozen
from kfit.data import ViewsDataModule
from kfit.pose import CategoryModel
from kfit.training.view_lens import view_lens

# Most objects, of ten views each, on which reconstruction is measured, of either kind; most views that codes are
# fitted to.
L1_OBJECTS, L1_FITTED = 100, 50
# Distance of these views in box diagonals: VAE2D and VAE3D draw from no other.
DISTANCE = (4.0, 4.0)
# No training has this seed, so all objects are new.
L1_SEED = 2_000_000


def l1_views(num_views: int) -> tuple[int, int]:
    """Objects of either kind on which reconstruction is measured, and views to which codes are fitted.

    Args:
        num_views: views on which poses are measured.
    """
    return min(num_views, L1_OBJECTS), min(num_views, L1_FITTED)


def novel_view_l1(model: CategoryModel, cache: Path, num_views: int) -> list[float]:
    """Mean |I − Î| of pictures drawn at their true poses.

    Of objects of the families held out of training, by what the encoder saw in another view; of new objects of the
    families that training showed, as the paper's are, likewise; and of some of the first by the code that draws the
    picture itself best, which shows what the generator can draw, whatever the encoder reads.

    Args:
        model: the trained networks.
        cache: folder of rendered views.
        num_views: see `l1_views`.
    """
    objects, fitted = l1_views(num_views)
    data = ViewsDataModule(
        model.card.category,
        objects,
        num_val_objects=objects,
        cache_dir=str(cache),
        distance_range=DISTANCE,
        seed=L1_SEED,
    )
    data.prepare_data()
    data.setup()
    held_out, known = data.val_pairs, data.train_pairs
    assert held_out is not None
    assert known is not None
    means = []
    for pairs in (held_out, known):
        batches = (pairs.__getitems__(range(i, min(i + 32, len(pairs)))) for i in range(0, len(pairs), 32))
        with torch.no_grad():
            each = [_apart(model, batch, model.encoder(batch["source"])[0]) for batch in batches]
        means.append(float(torch.cat(each).mean()))
    return [*means, _fitted_l1(model, held_out.__getitems__(range(0, len(held_out), len(held_out) // fitted)))]


def _apart(model: CategoryModel, batch: dict[str, Tensor], code: Tensor) -> Tensor:
    pose = {"azimuth": batch["azimuth"], "elevation": batch["elevation"]} | view_lens(model.generator, batch)
    drawn = model.generator(code=code, **pose).image
    apart: Tensor = (drawn - batch["target"]).abs().mean((1, 2, 3))
    return apart


def _fitted_l1(model: CategoryModel, batch: dict[str, Tensor]) -> float:
    with torch.no_grad():
        code = model.encoder(batch["target"])[0]
    code.requires_grad_()
    optimizer = torch.optim.Adam([code], lr=0.05)
    for _ in range(80):
        (code.grad,) = torch.autograd.grad(_apart(model, batch, code).sum(), code)
        optimizer.step()
    with torch.no_grad():
        return float(_apart(model, batch, code).mean())


def multiply_adds(generator: Generator) -> float:
    """Multiplications with an addition that the convolutions and linear layers of one picture take."""
    values = {name: torch.zeros(1, *variable.shape) for name, variable in generator.variables.items()}
    with FlopCounterMode(display=False) as counter:
        frozen(generator)(**values)
    return float(counter.get_total_flops()) / 2


def prior_samples(model: CategoryModel, count: int, seed: int) -> Tensor:
    """Pictures (count, 3, S, S) of codes drawn from the prior N(0, 1), seen half from the side."""
    rng = torch.Generator().manual_seed(seed)
    code = torch.randn(count, *model.generator.variables["code"].shape, generator=rng)
    pose = {"azimuth": torch.full((count,), 0.7 - math.pi), "elevation": torch.full((count,), 0.5)}
    with torch.no_grad():
        image: Tensor = model.generator(code=code, **pose).image
    return image
