"""Intervals of shares, and of differences between rows, over views pooled over seeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest  # type: ignore[import-untyped]

SAMPLES, LEVEL = 4000, 0.95
# Arrays of which a row is a view.
OF_VIEWS = ("rotation_deg", "translation_cm", "path_energy", "path_rotation")


class Interval(NamedTuple):
    """A number with the bounds of its 95 % interval."""

    value: float
    low: float
    high: float


def share_below(rotation_deg: NDArray[Any], limit: float) -> Interval:
    """Average precision in %: the share of views whose error (N,) is below a limit, with Wilson's interval.

    NaN, a failure, is below no limit. Wilson's interval also holds for few views and for shares of 0 and 100 %.
    """
    right = _right(rotation_deg, limit)
    low, high = binomtest(int(right.sum()), len(right)).proportion_ci(LEVEL, "wilson")
    return Interval(100 * float(right.mean()), 100 * float(low), 100 * float(high))


def difference(ours: NDArray[Any], others: NDArray[Any], limit: float) -> Interval:
    """How much larger the share of ``ours`` (N,) is than that of ``others`` (N,), errors in the same N views, in %.

    The interval is that of a paired bootstrap over the views.
    """
    if len(ours) != len(others):
        raise ValueError(f"rows must be of the same views, got {len(ours)} and {len(others)}")
    apart = 100.0 * (_right(ours, limit).astype(float) - _right(others, limit))
    return mean_of(apart)


def mean_of(values: NDArray[Any]) -> Interval:
    """Mean of values (N,) with a bootstrap's interval over them."""
    rng = np.random.default_rng(0)
    means = values[rng.integers(0, len(values), (SAMPLES, len(values)))].mean(1)
    low, high = np.quantile(means, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return Interval(float(values.mean()), float(low), float(high))


def agreement(ours: NDArray[Any], others: NDArray[Any], limit: float, published: float) -> str:
    """Compare an ordering that the paper prints with the measured one.

    A difference is outside the noise if its interval leaves out 0 and McNemar's exact test of the views in which the
    rows differ has p < 0.05. The bootstrap alone is too narrow for few views: 4 of 20 views leave out 0, at p = 0.125.

    Args:
        ours, others: errors (N,) of two rows in the same N views.
        limit: an error below it is right.
        published: the paper's difference between the two.

    Returns:
        "reproduced", "contradicted" or "within the noise".
    """
    measured = difference(ours, others, limit)
    better = int((_right(ours, limit) & ~_right(others, limit)).sum())
    worse = int((_right(others, limit) & ~_right(ours, limit)).sum())
    noise = measured.low <= 0 <= measured.high or binomtest(better, better + worse).pvalue >= 1 - LEVEL
    if noise or published == 0:
        return "within the noise"
    return "reproduced" if (measured.value > 0) == (published > 0) else "contradicted"


def pooled(seeds: Sequence[Mapping[str, NDArray[Any]]]) -> dict[str, NDArray[Any]]:
    """One row's arrays over all seeds: views one after the other, reconstruction errors in the mean, the rest by the
    first seed."""
    if len(seeds) == 1:
        return dict(seeds[0])
    found = dict(seeds[0])
    for name in found:
        if name in OF_VIEWS or " " in name:  # the robustness study's arrays have the change in their names
            found[name] = np.concatenate([arrays[name] for arrays in seeds])
        elif name == "l1":
            found[name] = np.mean([arrays[name] for arrays in seeds], 0)
    return found


def _right(rotation_deg: NDArray[Any], limit: float) -> NDArray[np.bool_]:
    return np.asarray(rotation_deg < limit)  # NaN is below nothing
