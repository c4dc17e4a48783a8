"""Intermediate values of an objective, and the concatenation of evaluations of chunks."""

from __future__ import annotations

from typing import Any, NamedTuple

import torch
from torch import Tensor

from kfit.core import Evaluation, Rendering, Variables


class RowInputs(NamedTuple):
    """Inputs of some rows that belong to their problems: numbers of pictures, prepared targets, the context."""

    problem: Tensor
    picture: Tensor
    targets: dict[str, Any]
    context: dict[str, Tensor]


class DrawnRows(NamedTuple):
    """Drawn and compared rows, with overlap and shortfall if the rendering has a weight."""

    values: Variables
    rendering: Rendering
    terms: dict[str, Tensor]
    residuals: list[Tensor]
    overlap: Tensor | None
    missing: Tensor | None


def joined_evaluation(chunks: list[Evaluation]) -> Evaluation:
    """Concatenate the evaluations of all chunks."""
    joined: Evaluation = _joined(chunks)
    return joined


def _joined(chunks: list[Any]) -> Any:
    """Concatenate the contents of chunks, tensor by tensor."""
    first = chunks[0]
    if isinstance(first, Tensor):
        return torch.cat(chunks)
    if isinstance(first, dict):
        return {name: _joined([chunk[name] for chunk in chunks]) for name in first}
    return None if first is None else type(first)(**_joined([vars(chunk) for chunk in chunks]))
