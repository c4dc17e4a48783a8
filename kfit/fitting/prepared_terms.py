"""What the terms of a fit prepared of its observation, gathered for the rows that are drawn."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, nullcontext
from typing import Any

import torch
from torch import Tensor
from torch.utils import _pytree as pytree

from kfit.core import Energy, Generator, Observation, Prior, Rendering, Variables
from kfit.core.pictures import at_least_single
from kfit.core.rows import pictures_of
from kfit.fitting.check_outputs import check_reached, check_rendering
from kfit.fitting.drawn_rows import RowInputs

# Pixels that are drawn at once. On a CPU a chunk of 16 pictures of 64 × 64 fits the cache and reuses its memory: with
# 120 at once a picture takes 1.7 × as long, with 2 at once as long as with 16.
CHUNK_PIXELS = {"cpu": 16 * 64 * 64}
CHUNK_PIXELS_ELSEWHERE = 512 * 64 * 64


class PreparedTerms:
    """The generator and the terms of one fit, with what they prepared of its observation.

    Args:
        generator: frozen.
        terms: energies and priors by name, frozen.
        observation: B problems.

    Attributes:
        num_evaluations: pictures drawn so far.
        chunk: the most rows that are drawn at once.
    """

    def __init__(self, generator: Generator, terms: Mapping[str, Energy | Prior], observation: Observation) -> None:
        self.generator, self.terms, self.observation = generator, terms, observation
        self.spaces = {name: variable.space for name, variable in generator.variables.items()}
        self.num_evaluations = 0
        self.device, self.views = observation.image.device.type, observation.views
        self.prepared: dict[str, Any] = {}
        for name, term in self.terms.items():
            if isinstance(term, Energy):
                term.check(observation.select(term.on), observation.weight)
            with self.precision(term):
                self.prepared[name] = (
                    term.prepare(observation.select(term.on), observation.weight)
                    if isinstance(term, Energy)
                    else term.prepare(observation.first_views())
                )
        self.context = dict(generator.prepare(observation))
        self._reached = False
        self._rows: tuple[Tensor, list[RowInputs]] | None = None
        size = observation.image[0, 0].numel()
        pixels = CHUNK_PIXELS.get(self.device, CHUNK_PIXELS_ELSEWHERE)
        self.chunk = max(1, pixels // (size * self.views))

    def draw(self, raw: Variables, rows: RowInputs) -> tuple[Variables, Rendering]:
        """Return values of rows, and their pictures in single precision or better."""
        values = {name: self.spaces[name].to_value(tensor) for name, tensor in raw.items()}
        drawn = self.generator(**values, **rows.context)
        check_rendering(self.generator, drawn)
        return values, drawn.map(at_least_single)

    def precision(self, term: Energy | Prior) -> AbstractContextManager[Any]:
        """Return a context of the current precision for terms that can compare in it, else of single precision."""
        mixed = isinstance(term, Energy) and term.mixed
        return nullcontext() if mixed else torch.autocast(self.device, enabled=False)

    def chunks(self, raw: Variables, problem: Tensor) -> Iterator[tuple[Variables, RowInputs]]:
        """Yield even parts of at most `chunk` rows; one empty part if there are no rows.

        The inputs of their problems are gathered again only if the rows have changed.
        """
        rows, count = len(problem), max(1, -(-len(problem) // self.chunk))
        self.num_evaluations += rows * self.views
        parts = [slice(rows * part // count, rows * (part + 1) // count) for part in range(count)]
        if self._rows is None or not torch.equal(self._rows[0], problem):
            self._rows = (problem, [self.gather(problem[part]) for part in parts])
        for part, gathered in zip(parts, self._rows[1], strict=True):
            yield {name: tensor[part] for name, tensor in raw.items()}, gathered

    def gather(self, problem: Tensor) -> RowInputs:
        """Return the inputs of rows of the problems (N,)."""
        picture = pictures_of(problem, self.views)
        targets = {
            name: rows_of(prepared, picture if isinstance(self.terms[name], Energy) else problem)
            for name, prepared in self.prepared.items()
        }
        return RowInputs(problem, picture, targets, rows_of(self.context, problem))

    def check_reached(self, raw: Variables, rows: RowInputs, missing: list[str]) -> None:
        """Refuse, once a fit, a generator through which no gradient reaches a variable.

        Raises:
            ValueError: naming those of ``missing``, on which the energies do not depend.
        """
        if not self._reached and len(rows.problem):
            check_reached(self.generator, self.terms, raw, rows.context, missing)
            self._reached = True


def rows_of(prepared: Any, rows: Tensor) -> Any:
    """Return the rows (N,) of each tensor in a pytree."""
    return pytree.tree_map_only(Tensor, lambda tensor: tensor.index_select(0, rows), prepared)
