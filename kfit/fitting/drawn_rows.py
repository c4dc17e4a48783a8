"""What an objective hands from drawing to comparing, and one evaluation of several chunks."""

from __future__ import annotations

from typing import Any, NamedTuple

import torch
from torch import Tensor

from kfit.core import Evaluation, Rendering, Variables


class RowInputs(NamedTuple):
    """What belongs to the problems of some rows: numbers of pictures, features of targets, the context."""

    problem: Tensor
    picture: Tensor
    targets: dict[str, Any]
    context: dict[str, Tensor]


class DrawnRows(NamedTuple):
    """Rows as drawn and compared; of what a generator does not vouch for, the overlap and what is missing of it."""

    values: Variables
    rendering: Rendering
    terms: dict[str, Tensor]
    residuals: list[Tensor]
    overlap: Tensor | None
    missing: Tensor | None


def joined_evaluation(chunks: list[Evaluation]) -> Evaluation:
    """One evaluation of the rows of all chunks."""
    joined: Evaluation = _joined(chunks)
    return joined


def _joined(chunks: list[Any]) -> Any:
    """One evaluation of all rows: what the chunks hold, tensor by tensor."""
    first = chunks[0]
    if isinstance(first, Tensor):
        return torch.cat(chunks)
    if isinstance(first, dict):
        return {name: _joined([chunk[name] for chunk in chunks]) for name in first}
    return None if first is None else type(first)(**_joined([vars(chunk) for chunk in chunks]))
