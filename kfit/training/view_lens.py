"""The focal lengths of views that were drawn from different distances."""

from __future__ import annotations

from collections.abc import Mapping

from torch import Tensor

from kfit.core import Generator, Variables
from kfit.geometry import focal_by_distance


def view_lens(generator: Generator, batch: Mapping[str, Tensor]) -> Variables:
    """Set ``focal`` (N,) by the distances of a batch's cameras, where the batch has them and the generator a ``focal``.

    Args:
        generator: with ``unit_fraction``, as `kfit.generators.RadianceField`, if it has a ``focal``.
        batch: batch of `kfit.data.ViewPairs`.
    """
    if "focal" not in generator.variables or "distance" not in batch:
        return {}
    return {"focal": focal_by_distance(batch["distance"], generator.unit_fraction)}  # type: ignore[arg-type]
