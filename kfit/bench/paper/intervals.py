"""How sure differences between rows are: paired bootstrap over views, pooled over seeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

SAMPLES, LEVEL = 4000, 0.95
# Arrays of which a row is a view.
OF_VIEWS = ("rotation_deg", "translation_cm")


class Interval(NamedTuple):
    """A number with the bounds that hold it with a probability of 95 %."""

    value: float
    low: float
    high: float

    @property
    def sign(self) -> int:
        """1 or −1 where the number is surely above or below 0, else 0."""
        return (self.low > 0) - (self.high < 0)


def share_below(rotation_deg: NDArray[Any], limit: float) -> Interval:
    """Average precision in %: the share of views whose error (N,) is below a limit; NaN, a failure, is below none."""
    return _bootstrap(100.0 * (np.nan_to_num(rotation_deg, nan=180.0) < limit))


def difference(ours: NDArray[Any], others: NDArray[Any], limit: float) -> Interval:
    """How much larger the share of ``ours`` (N,) is than that of ``others`` (N,), errors in the same N views, in %."""
    if len(ours) != len(others):
        raise ValueError(f"rows must be of the same views, got {len(ours)} and {len(others)}")
    right = [np.nan_to_num(errors, nan=180.0) < limit for errors in (ours, others)]
    return _bootstrap(100.0 * (right[0].astype(float) - right[1]))


def verdict(measured: Interval, published: float) -> str:
    """Whether an ordering that the paper prints shows here: "yes", "no", or "open" where noise hides it."""
    wanted = int(np.sign(published))
    if not wanted or not measured.sign:
        return "open"
    return "yes" if measured.sign == wanted else "no"


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


def _bootstrap(values: NDArray[np.float64]) -> Interval:
    rng = np.random.default_rng(0)
    means = values[rng.integers(0, len(values), (SAMPLES, len(values)))].mean(1)
    low, high = np.quantile(means, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return Interval(float(values.mean()), float(low), float(high))
