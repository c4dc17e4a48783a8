"""Confidence in a tracked pose, by the model's calibration and its pose head."""

from __future__ import annotations

import torch

from kfit.core import FitResult, Observation
from kfit.geometry import PoseNetwork
from kfit.pose.category_model import CategoryModel
from kfit.pose.confidence import DOUBTFUL, evidence
from kfit.pose.hypotheses import alternatives, head_probability


def pose_head_of(model: CategoryModel) -> PoseNetwork:
    """Return the model's pose head.

    Raises:
        ValueError: if it has none.
    """
    if model.pose_head is None:
        raise ValueError(f"track: the model of {model.card.category} has no pose head, which tracking needs")
    return model.pose_head


def track_confidence(model: CategoryModel, ranked: FitResult, observation: Observation) -> float:
    """Return the probability that the better one of two compared poses is right.

    Args:
        model: with a pose head.
        ranked: fit of one problem whose starts are the compared poses.
        observation: one crop, with the pose head's prediction.
    """
    symmetry, head = model.card.known.symmetry, pose_head_of(model)
    log_probability = model.pose_log_probabilities(observation)
    found = alternatives(ranked, torch.eye(3).double(), symmetry)
    near = None if log_probability is None else head_probability(ranked, log_probability[0], head, symmetry)
    calibration, features = model.card.calibration.get("RGB"), evidence(found, near)
    if calibration is None or not set(calibration.coefficients) <= set(features):
        return found[0].weight
    probability = calibration.probability(features)
    return probability if calibration.explains(found[0].energy) else min(probability, DOUBTFUL)
