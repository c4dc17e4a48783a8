"""Fitting a calibration to held-out answers, and measuring its reliability."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize  # type: ignore[import-untyped]
from scipy.special import expit  # type: ignore[import-untyped]

from kfit.pose.confidence import UNMEASURED, Calibration

FOLDS = 10
# Of χ² with 6 degrees of freedom: the bound of the ellipsoid that holds 95 % of a Gaussian's poses.
CHI2_95 = 12.592
BINS = (0.0, 0.5, 0.7, 0.8, 0.9, 0.95, 1.0)


def calibrate(
    features: Sequence[dict[str, float]],
    right: Sequence[bool],
    energy: Sequence[float],
    fits: dict[str, Any],
    seed: int,
    distances: Sequence[float],
) -> Calibration:
    """Fit a calibration to N answers of held-out views, with the results of a cross-validation on them.

    Args:
        features: result of `kfit.pose.confidence.evidence` for each.
        right: whether each is right.
        energy: energy of each.
        fits: how they were fitted, as returned by `kfit.pose.confidence.how_fitted`.
        seed: seed of the views.
    """
    found = {"seed": seed, "right answers": len(distances), **reliability(cross_validated(features, right), right)}
    energy_99, factor = float(np.quantile(energy, 0.99)), covariance_factor(distances)
    return Calibration(*calibrated(features, right), energy_99, fits, len(features), found, factor)


def covariance_factor(distances: Sequence[float]) -> float:
    """Factor by which covariances are multiplied, so that their 95 % ellipsoids hold 95 % of new answers of the kind.

    The ⌈0.95 (N + 1)⌉-th smallest of N squared distances δᵀ C⁻¹ δ (the largest, where N < 19) over the 95 % bound of
    χ² with 6 degrees of freedom: split conformal prediction (Lei et al., JASA 2018), which assumes no distribution.

    >>> covariance_factor([CHI2_95 * 2] * 40)
    2.0
    """
    if not distances:
        return UNMEASURED
    place = min(len(distances), math.ceil(0.95 * (len(distances) + 1)))
    return float(np.sort(distances)[place - 1] / CHI2_95)


def calibrated(features: Sequence[dict[str, float]], right: Sequence[bool]) -> tuple[float, dict[str, float]]:
    """Fit bias and coefficients of a logistic model of N answers by penalised maximum likelihood.

    The penalty is ½ Σ_k (c_k s_k)², s the standard deviations, and no c_k is below 0, so that chance does not turn
    evidence for an answer into evidence against it. Right answers have the target (N₊ + 1) / (N₊ + 2), wrong ones
    1 / (N₋ + 2), so that a few views without a failure do not give certainty (Platt, Probabilistic outputs for support
    vector machines, 1999).

    Args:
        features: result of `evidence` for each, all with the same names.
        right: whether each is right.

    Raises:
        ValueError: if there are no answers, or the lengths differ.
    """
    if not features or len(features) != len(right):
        raise ValueError(f"features and right must be of one length above 0, got {len(features)} and {len(right)}")
    names = list(features[0])
    rows = np.array([[one[name] for name in names] for one in features], float)
    mean, std = rows.mean(0), rows.std(0)
    rows = (rows - mean) / np.where(std > 1e-9, std, 1.0)
    yes = np.asarray(right, bool)
    target = np.where(yes, (yes.sum() + 1) / (yes.sum() + 2), 1 / ((~yes).sum() + 2))

    def loss(x: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        logit = x[0] + rows @ x[1:]
        away = expit(logit) - target
        value = float((np.logaddexp(0, logit) - target * logit).sum() + 0.5 * (x[1:] ** 2).sum())
        return value, np.concatenate([[away.sum()], rows.T @ away + x[1:]])

    bounds = [(None, None), *[(0.0, None)] * len(names)]
    found = minimize(loss, np.zeros(1 + len(names)), jac=True, method="L-BFGS-B", bounds=bounds).x
    per_unit = found[1:] / np.where(std > 1e-9, std, 1.0)
    return float(found[0] - per_unit @ mean), dict(zip(names, per_unit.tolist(), strict=True))


def cross_validated(features: Sequence[dict[str, float]], right: Sequence[bool]) -> list[float]:
    """Return probabilities that N ≥ 2 answers are right, each by a model of the answers of the other folds."""
    confidences = [0.0] * len(features)
    for first in range(min(FOLDS, len(features))):
        others = [k for k in range(len(features)) if k % FOLDS != first]
        fitted = calibrated([features[k] for k in others], [right[k] for k in others])
        model = Calibration(*fitted, math.inf, {}, len(others))
        for k in range(first, len(features), FOLDS):
            confidences[k] = model.probability(features[k])
    return confidences


def reliability(confidences: Sequence[float], right: Sequence[bool]) -> dict[str, Any]:
    """Measure how well N probabilities predict which answers are right.

    Returns:
        ``right``: fraction of right answers; ``brier``: mean (p − right)², and ``brier of the share``: the same if p
        were this fraction for all; ``calibration error``: Σ_b N_b / N · |mean p − fraction right| over bins b (Guo et
        al., On calibration of modern neural networks, 2017); ``bins``: ``from``, ``to``, ``number``, ``predicted``
        (mean p) and ``right`` of each bin that is not empty.
    """
    p, yes = np.asarray(confidences, float), np.asarray(right, float)
    place = np.clip(np.searchsorted(BINS, p, side="right") - 1, 0, len(BINS) - 2)
    bins = [
        {
            "from": BINS[b],
            "to": BINS[b + 1],
            "number": int((place == b).sum()),
            "predicted": float(p[place == b].mean()),
            "right": float(yes[place == b].mean()),
        }
        for b in range(len(BINS) - 1)
        if (place == b).any()
    ]
    return {
        "right": float(yes.mean()),
        "brier": float(((p - yes) ** 2).mean()),
        "brier of the share": float(((yes.mean() - yes) ** 2).mean()),
        "calibration error": sum(b["number"] * abs(b["predicted"] - b["right"]) for b in bins) / len(p),
        "bins": bins,
    }
