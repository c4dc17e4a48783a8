"""The fits of `kfit bench minimum`: from known poses, with the energies and optimizers that are compared."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from kfit.bench.held_out_views import HeldOutViews
from kfit.core import Energy, Initializer, Observation, Optimizer, Variable, Variables
from kfit.energies import CodePrior, LearnedScore
from kfit.features import PoseRefiner
from kfit.fitting.pipeline import FitPipeline
from kfit.generators import SimilarityWarp
from kfit.geometry import (
    angles_from_rotation,
    focal_by_distance,
    rotation_error,
    rotation_from_angles,
    updated_rotation,
)
from kfit.initializers import EncoderPosterior, FromCamera
from kfit.optimizers import Adam, LearnedSteps, Stages
from kfit.pose import CategoryModel
from kfit.pose.defaults import BETAS, FINAL_RATE_FRACTION, RATES, default_energies

NUM_STEPS = 20
# Learned steps before the descent.
NUM_LEARNED = 3
# Poses of which the true one is one, how many of the others are flips, and how far the rest lie, in degrees.
NUM_POSES, NUM_FLIPS, WITHIN_DEG = 32, 7, 30.0
POSE = ("azimuth", "elevation", "roll", "shift", "scale")


class Candidate(NamedTuple):
    """An energy with the way that a fit descends it.

    Attributes:
        weights: weights of the energies by name, see `energies_of`.
        prior: weight of the code's prior.
        code_rate: learning rate of Adam for the code, 0 to hold the code.
        learned: steps of the refiner before Adam's.
        descended: steps of Adam.
    """

    weights: Mapping[str, float]
    prior: float = 0.02
    code_rate: float = RATES["code"]
    learned: int = 0
    descended: int = NUM_STEPS


def candidates(refined: bool) -> dict[str, Candidate]:
    """Return what is compared, by its name in tables: with a refiner, learned steps and its score too."""
    weights = {name: weight for name, (_, weight) in default_energies().items()}
    plain = {
        "default energies": Candidate(weights),
        "EfficientNet alone": Candidate({"perceptual": 1.0}),
        "SSIM alone": Candidate({"ssim": 2.0}),
        "silhouette alone": Candidate({"silhouette": 5.0}),
        "silhouette × 4": Candidate(weights | {"silhouette": 20.0}),
        "code's prior × 10": Candidate(weights, prior=0.2),
        "code held": Candidate(weights, code_rate=0.0),
    }
    learned = {
        "one learned step": Candidate({"score": 1.0}, learned=1, descended=0),
        f"{NUM_LEARNED} learned steps": Candidate({"score": 1.0}, learned=NUM_LEARNED, descended=0),
        f"{NUM_LEARNED} learned steps, default energies": Candidate(weights, learned=NUM_LEARNED),
        f"{NUM_LEARNED} learned steps, default energies, learned score": Candidate(
            weights | {"score": 1.0}, learned=NUM_LEARNED
        ),
    }
    return plain | learned if refined else plain


def energies_of(weights: Mapping[str, float], refiner: PoseRefiner | None) -> dict[str, Energy]:
    """Return the energies that have a weight: kfit's defaults by their names, and ``score``."""
    known: dict[str, Energy] = {name: energy for name, (energy, _) in default_energies().items()}
    if refiner is not None:
        known["score"] = LearnedScore(refiner)
    return {name: known[name] for name in weights}


class KnownPoses(Initializer):
    """Starts at given values, those of a problem one after another."""

    on = POSE

    def __init__(self, values: Variables) -> None:
        self.values = values

    def __call__(
        self,
        variables: Mapping[str, Variable],
        observation: Observation,
        num_starts: int,
        rngs: Sequence[torch.Generator],
    ) -> Variables:
        return self.values


def fit_from(
    model: CategoryModel, candidate: Candidate, poses: Variables, num_starts: int, refiner: PoseRefiner | None
) -> FitPipeline:
    """The candidate's fit from known poses, ``num_starts`` of each problem.

    The score ranks and is not descended.
    """
    names = {**RATES, "code": candidate.code_rate, "focal": 0.0}
    drawn = SimilarityWarp(model.generator)
    stages: list[tuple[Optimizer, int]] = []
    if candidate.learned and refiner is not None:
        stages.append((LearnedSteps(refiner), candidate.learned))
    if candidate.descended:
        decay = FINAL_RATE_FRACTION ** (1 / candidate.descended)
        rates = {name: names[name] for name in drawn.variables}
        stages.append((Adam(rates, BETAS, decay), candidate.descended))
    weights = {**candidate.weights, "prior": candidate.prior}
    return FitPipeline(
        drawn,
        {**energies_of(candidate.weights, refiner), "prior": CodePrior()},
        [KnownPoses(poses), EncoderPosterior(model.encoder), *([FromCamera()] if "focal" in drawn.variables else [])],
        Stages(stages) if stages else Adam(),
        weights={name: 0.0 if name == "score" else weight for name, weight in weights.items()},
        rank_weights=weights,
        num_starts=num_starts,
        num_steps=candidate.learned + candidate.descended,
        history=1000,
    )


def true_poses(model: CategoryModel, views: HeldOutViews) -> Variables:
    """The values (N, …) with which the generator draws upright views at their true poses."""
    azimuth, elevation, roll = (angle.float() for angle in angles_from_rotation(views.rotation))
    pixel = (views.intrinsics @ views.translation[..., None])[..., 0]
    centre = torch.tensor([crop.centre for crop in views.crops], dtype=pixel.dtype)
    side = torch.tensor([crop.side for crop in views.crops], dtype=pixel.dtype)
    shift = (pixel[:, :2] / pixel[:, 2:] - centre) / (side[:, None] / 2) * pixel.new_tensor([1.0, -1.0])
    focal = focal_by_distance(torch.tensor(model.card.distance), model.card.unit_fraction)
    scale = views.intrinsics[:, 0, 0] / side / focal
    return {"azimuth": azimuth, "elevation": elevation, "roll": roll, "shift": shift.float(), "scale": scale.float()}


def rotated_poses(poses: Variables, rotation: Tensor) -> Variables:
    """The same poses with other rotations (N · S, 3, 3), S of each."""
    count = len(rotation) // len(poses["scale"])
    angles = dict(zip(POSE, (angle.float() for angle in angles_from_rotation(rotation)), strict=False))
    return angles | {name: poses[name].repeat_interleave(count, 0) for name in ("shift", "scale")}


def off_by(rotation: Tensor, degrees: float, rng: torch.Generator) -> Tensor:
    """Rotations (N, 3, 3) turned by an angle about random axes; of these that move the vertical axis by as much."""
    axis = torch.linalg.cross(
        torch.randn(len(rotation), 3, generator=rng, dtype=rotation.dtype), rotation[:, :, 1], dim=1
    )
    return updated_rotation(rotation, math.radians(degrees) * torch.nn.functional.normalize(axis, dim=1))


def around(rotation: Tensor, rng: torch.Generator) -> Tensor:
    """`NUM_POSES` rotations for each of (N, 3, 3): the true one, flips of it, and others within 30°."""
    turns = [(180, 0, 0), (0, 180, 0), (0, 0, 180), (90, 0, 0), (-90, 0, 0), (180, 30, 0), (180, -30, 0)]
    angles = torch.tensor(turns, dtype=rotation.dtype).deg2rad()
    flips = rotation[:, None] @ rotation_from_angles(angles[:, 0], angles[:, 1], angles[:, 2])
    near = rotation.repeat_interleave(NUM_POSES - 1 - NUM_FLIPS, 0)
    axis = torch.nn.functional.normalize(torch.randn(len(near), 3, generator=rng, dtype=rotation.dtype), dim=1)
    # Not nearer than 5°, where poses are as good as the true one.
    angle = 5 + (WITHIN_DEG - 5) * torch.rand(len(near), 1, generator=rng, dtype=rotation.dtype)
    near = updated_rotation(near, angle.deg2rad() * axis).unflatten(0, (len(rotation), -1))
    return torch.cat([rotation[:, None], flips, near], 1).flatten(0, 1)


def errors_of(model: CategoryModel, views: HeldOutViews, values: Variables) -> Tensor:
    """Rotation errors (N,) in degrees; symmetric classes, and mugs whose handle is hidden, count by their axis."""
    found = rotation_from_angles(*(values[name].double() for name in ("azimuth", "elevation", "roll")))
    full, by_axis = (rotation_error(found, views.rotation, how) for how in (model.card.known.symmetry, "y"))
    return torch.where(views.visible, full, by_axis).rad2deg()
