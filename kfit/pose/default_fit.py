"""The fit of one category's object that `kfit.pose.CategoryModel.pose` runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from kfit.callbacks import Pruning
from kfit.core import Callback, Encoder, Energy, Generator, Initializer, Prior
from kfit.energies import CodePrior, Depth, GemanMcClure, LensPrior, PosePrior
from kfit.fitting.pipeline import FitPipeline
from kfit.generators import MetricDepth, MultiView, SimilarityWarp
from kfit.geometry import PoseNetwork
from kfit.initializers import Constant, EncoderPosterior, FromCamera, FromDepth, PosePosterior, SphereGrid
from kfit.optimizers import Adam
from kfit.pose.card import Card
from kfit.pose.confidence import LENS_WEIGHT
from kfit.pose.defaults import (
    BETAS,
    DEPTH_SCALE,
    DEPTH_WEIGHT,
    DIAGONAL_RATE,
    DISTANCE_RATE,
    FINAL_RATE_FRACTION,
    FOCAL_RATE,
    RATES,
)


def default_fit(
    generator: Generator,
    encoder: Encoder,
    pose_head: PoseNetwork | None,
    card: Card,
    image_size: int,
    energies: Mapping[str, tuple[Energy, float]],
    *,
    num_starts: int,
    num_steps: int,
    callbacks: Sequence[Callback] | None,
    depth: bool,
    lens_known: bool,
    views: float | None,
) -> FitPipeline:
    """Build the fit that `kfit.pose.CategoryModel.pipeline` describes, with its arguments."""
    if depth and views is not None:
        raise ValueError("depth and views were both given; several photos are fitted to colour alone")
    drawn: Generator = SimilarityWarp(generator)
    parts: dict[str, Energy | Prior] = {name: energy for name, (energy, _) in energies.items()}
    parts["prior"] = CodePrior()
    fixed: dict[str, float | list[float]] = {"shift": 0.0, "scale": 1.0}
    initializers: list[Initializer] = [
        PosePosterior(pose_head) if pose_head else SphereGrid(elevation_deg=(0.0, 60.0)),
        EncoderPosterior(encoder),
        Constant(fixed if pose_head else fixed | {"roll": 0.0}),
    ]
    weights = {name: weight for name, (_, weight) in energies.items()} | {"prior": 0.02}
    rates = dict(RATES)
    if depth:
        drawn = MetricDepth(drawn, card.unit_fraction)
    if "focal" in drawn.variables:
        initializers.append(FromCamera())
        rates["focal"] = 0.0 if lens_known else FOCAL_RATE
        if not lens_known:
            parts["lens"], weights["lens"] = LensPrior(card.mean_diagonal, card.unit_fraction), LENS_WEIGHT
    if pose_head is not None:
        parts["pose"], weights["pose"] = PosePrior(pose_head), card.pose_weight
    if depth:
        parts["depth"], weights["depth"] = Depth(GemanMcClure(DEPTH_SCALE * card.mean_diagonal)), DEPTH_WEIGHT
        initializers = [FromDepth(drawn, initializers)]
        rates["distance"] = DISTANCE_RATE
    if views is not None:
        drawn = MultiView(drawn, image_size, card.unit_fraction)
        initializers.append(Constant({"diagonal": views}))
        rates["diagonal"] = DIAGONAL_RATE
    return FitPipeline(
        drawn,
        parts,
        initializers,
        Adam(rates, BETAS, FINAL_RATE_FRACTION ** (1 / max(1, num_steps))),
        weights=dict(weights),
        rank_weights={name: weight for name, weight in weights.items() if name != "lens"},
        callbacks=[Pruning({3: max(1, num_starts // 2)})] if callbacks is None else callbacks,
        num_starts=num_starts,
        num_steps=num_steps,
        num_candidates=(16 if pose_head is None else 4) * num_starts,
    )
