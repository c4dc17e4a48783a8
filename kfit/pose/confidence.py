"""Confidence of an answer: the probability that its rotation is right."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import torch

from kfit.core import FitResult
from kfit.core.check import check_names
from kfit.pose.result import Alternative

# Probabilities are clipped to [LEAST, 1 − LEAST], so that their logits are finite.
LEAST = 0.01
# Upper bound of the confidence for pictures unlike those of the calibration.
DOUBTFUL = 0.5
# Weight of the prior on an unknown lens in the energy. It is independent of the pose: not used for ranking or
# calibration.
LENS_WEIGHT = 0.05
# How the sentence on a confidence begins that is no probability.
UNCALIBRATED = "confidence not calibrated"
# Factor of covariances where a card has none: what `kfit.pose.calibrating.covariance_factor` gives on 22 right answers
# of 24 table views of unseen mugs (seed 7), the category whose covariances were furthest too small.
UNMEASURED = 1.7
EVIDENCE = ("weight", "energy", "agreement", "looks")


@dataclass(frozen=True)
class Calibration:
    """Logistic model of whether an answer is right, p = σ(bias + Σ_k c_k · evidence_k), and its domain.

    Attributes:
        bias: bias of the logit.
        coefficients: c_k ≥ 0 by the names that `evidence` returns.
        energy_99: 99 % of the held-out views' winners have a lower energy.
        fits: how those views were fitted, as returned by `how_fitted`.
        views: number of views.
        measured: their seed, and the results of a cross-validation.
    """

    bias: float
    coefficients: dict[str, float]
    energy_99: float
    fits: dict[str, Any]
    views: int
    measured: dict[str, Any] = field(default_factory=dict)
    covariance_factor: float = UNMEASURED

    @staticmethod
    def of(content: Any) -> Calibration:
        """Read a calibration from a card.

        Raises:
            ValueError: if an entry is missing, unknown or not finite.
        """
        names = {f.name for f in fields(Calibration)}
        if isinstance(content, dict):
            content = {"covariance_factor": UNMEASURED, **content}  # cards from before it was measured
        if not isinstance(content, dict) or set(content) != names:
            raise ValueError(f"a calibration must hold just {', '.join(sorted(names))}")
        found = Calibration(**content)
        try:
            check_names("coefficients", found.coefficients, EVIDENCE)
            numbers = [
                found.bias,
                found.energy_99,
                found.views,
                found.covariance_factor,
                *found.coefficients.values(),
                *found.fits["weights"].values(),
            ]
            # The bound keeps sums of products finite.
            fine = all(abs(number) < 1e9 for number in numbers) and isinstance(found.measured, dict)
            fine &= set(found.fits) == {"starts", "steps", "left", "weights"} and found.covariance_factor > 0
        except (AttributeError, KeyError, TypeError):
            fine = False
        if not fine:
            raise ValueError(
                "a calibration's bias, coefficients, energy_99, views, covariance_factor (above 0) and the weights in "
                "fits must be finite numbers below 1e9, and fits must hold starts, steps, left and weights"
            )
        return found

    def probability(self, features: dict[str, float]) -> float:
        """Return the probability in [0, 1] that a rotation is within 20° of the truth, by the `evidence` of its fit."""
        logit = self.bias + sum(c * features[name] for name, c in self.coefficients.items())
        return float(torch.tensor(logit, dtype=torch.float64).sigmoid())

    def explains(self, energy: float) -> bool:
        """Return whether an answer's energy is not above that of 99 % of the held-out views."""
        return energy <= self.energy_99

    def covers(self, fit: FitResult) -> bool:
        """Return whether a fit was made like those of the calibration: starts, steps, survivors, terms and weights.

        The prior of an unknown lens is ignored. Weights are tested on the fit's last step, whose energies must be
        E = Σ_k w_k · e_k.
        """
        weights, terms = self.fits["weights"], dict(fit.history.terms)
        lens = terms.pop("lens", torch.zeros(1))
        if set(terms) != set(weights) or how_fitted(fit, weights) != self.fits:
            return False
        energy = fit.history.energy[-1] - LENS_WEIGHT * lens[-1]
        sums = torch.stack([weight * terms[name][-1] for name, weight in weights.items()]).sum(0)
        there = energy.isfinite()
        return bool(torch.allclose(sums[there], energy[there], rtol=1e-3, atol=1e-5))


def confidence(
    calibration: Calibration | None,
    fit: FitResult,
    found: Sequence[Alternative],
    head_share: float | None,
    colour_calibration: Calibration | None = None,
) -> tuple[float, str | None]:
    """Return an answer's confidence in [0, 1], and a sentence if it is not calibrated or the energy is unusually high.

    Without a calibration, or for a fit made in another way, it is the answer's fraction of the starts' weight. If the
    energy is above that of 99 % of the held-out views, it is at most 0.5. A fit with depth without a calibration has at
    most the probability that the calibration of fits without depth gives to its other terms.

    Args:
        calibration: calibration of the model.
        fit: fit of one problem.
        found: its alternatives, the answer first.
        head_share: the share of probability that a pose head gives the answer, if there is one.
        colour_calibration: calibration of the model's fits without depth.
    """
    share = "it is the answer's share of the starts' weight, and no probability of being right"
    if calibration is None:
        probability, warning = (
            found[0].weight,
            f"{UNCALIBRATED}, as the model's card has no calibration of such fits: {share}",
        )
        colour_energy = None if colour_calibration is None else _colour_energy(fit, found[0].energy, colour_calibration)
        if colour_calibration is None or colour_energy is None:
            return probability, warning
        # Depth seldom makes an answer worse, and a drawing that explains the picture poorly stays doubtful with it.
        features = evidence([replace(found[0], energy=colour_energy), *found[1:]], head_share)
        if set(colour_calibration.coefficients) <= set(features):
            probability = min(probability, colour_calibration.probability(features))
        if not colour_calibration.explains(colour_energy):
            probability = min(probability, DOUBTFUL)
            warning += (
                f"; the drawing explains the look of the picture poorly, and it is {100 * DOUBTFUL:.0f} % at most"
            )
        return probability, warning
    features, energy = evidence(found, head_share), found[0].energy
    if not calibration.covers(fit) or not set(calibration.coefficients) <= set(features):
        return found[0].weight, f"{UNCALIBRATED} for a fit in another way than the model's own: {share}"
    probability = calibration.probability(features)
    if not calibration.explains(energy):
        return min(probability, DOUBTFUL), (
            f"the drawing explains the picture poorly: of {calibration.views} held-out views 99 % have an energy below "
            f"{calibration.energy_99:.2f}, this one has {energy:.2f}; the object may be unlike those of training, or "
            f"the mask wrong, and the confidence is {100 * DOUBTFUL:.0f} % at most"
        )
    return probability, None


def _colour_energy(fit: FitResult, energy: float, known: Calibration) -> float | None:
    """Return the weighted sum of a calibration's terms at the winner's ``energy``; None if the fit lacks a term."""
    history, weights, start = fit.history, known.fits["weights"], int(fit.start[0])
    if not set(weights) <= set(history.terms):
        return None
    step = int((history.energy[:, 0, start].double() - energy).abs().nan_to_num(torch.inf).argmin())
    return float(sum(weight * history.terms[name][step, 0, start] for name, weight in weights.items()))


def how_fitted(fit: FitResult, weights: dict[str, float]) -> dict[str, Any]:
    """Return the numbers of starts, steps and final starts of a fit, with the weights of its terms."""
    energy = fit.history.energy
    left = int(energy[-1].isfinite().sum(-1).max()) if energy.dim() == 3 and len(energy) else 0
    starts, steps = (energy.shape[2], len(energy) - 1) if energy.dim() == 3 else (0, 0)
    return {"starts": starts, "steps": steps, "left": left, "weights": dict(weights)}


def evidence(found: Sequence[Alternative], head_share: float | None) -> dict[str, float]:
    """What speaks for an answer; the more the surer.

    - ``weight``: logit of the share w of the starts' weight that the answer has.
    - ``energy``: −log E of the answer's energy E.
    - ``agreement``: −log(1 + spread), in degrees, of the answer's starts.
    - ``looks``: logit of the share of probability that a pose head gives the answer, where there is a head.

    Args:
        found: the alternatives, the answer first.
        head_share: the pose head's share.
    """
    answer = found[0]
    features = {
        "weight": _logit(answer.weight),
        "energy": -math.log(max(answer.energy, 1e-6)),
        "agreement": -math.log1p(answer.sigma_deg),
    }
    return features if head_share is None else features | {"looks": _logit(head_share)}


def _logit(share: float) -> float:
    kept = min(max(share, LEAST), 1 - LEAST)
    return math.log(kept / (1 - kept))
