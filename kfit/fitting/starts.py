"""Initial values from a pipeline's initializers, each with its own random numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch
from torch import Tensor

from kfit.core import Initializer, Observation, Variable, Variables
from kfit.core.check import check_names
from kfit.core.evaluate import Evaluate
from kfit.core.rows import best_first, finite
from kfit.core.seeds import mixed_seed


def initialize(
    initializers: Sequence[Initializer],
    variables: Mapping[str, Variable],
    observation: Observation,
    count: int,
    seed: int,
) -> Variables:
    """Return raw numbers (B · count, \\*shape) of each variable.

    Args:
        initializers: together they set each variable once.
        variables: variables of the generator.
        observation: B problems.
        count: starts a problem.
        seed: with the problems' keys it determines the random numbers.

    Raises:
        ValueError: if an initializer sets other variables than its ``on``, or another shape.
    """
    raw: Variables = {}
    for initializer in initializers:
        # Each initializer draws from its own stream, so exchanging one leaves the numbers of the others alone.
        rngs = [
            torch.Generator().manual_seed(mixed_seed(seed, key, ",".join(initializer.on)))
            for key in observation.keys or (0,) * observation.num_problems
        ]
        with _in_full_precision(observation):
            values = initializer(variables, observation, count, rngs)
        name = type(initializer).__name__
        check_names(f"{name} set", values, initializer.on, complete=True)
        raw |= raw_starts(name, values, variables, observation, count)
    return {name: raw[name] for name in variables}


def raw_starts(
    who: str, values: Variables, variables: Mapping[str, Variable], observation: Observation, count: int
) -> Variables:
    """Raw numbers of values (B · count, \\*shape), in the precision and where the observation is.

    Args:
        who: sets them, for the errors.
        values: by name.
        variables: variables of the generator.
        observation: B problems.
        count: starts a problem.

    Raises:
        ValueError: for values of another shape.
    """
    raw = {}
    for name, value in values.items():
        expected = (observation.num_problems * count, *variables[name].shape)
        if tuple(value.shape) != expected:
            raise ValueError(f"{who} must give {name!r} in shape {expected}, got {tuple(value.shape)}")
        with _in_full_precision(observation):
            raw[name] = variables[name].space.to_raw(value.to(observation.image))
    return raw


def _in_full_precision(observation: Observation) -> torch.autocast:
    """Return a context without autocast, which would round the starts."""
    return torch.autocast(observation.image.device.type, enabled=False)


def likeliest(evaluate: Evaluate, raw: Variables, num_candidates: int, num_starts: int) -> Variables:
    """Return the candidates (B · num_starts, \\*shape) of least ranking energy, in their original order.

    Args:
        evaluate: draws them once.
        raw: (B · num_candidates, \\*shape) of each variable.
        num_candidates, num_starts: of each problem.
    """
    if num_candidates == num_starts:
        return raw
    first = next(iter(raw.values()))
    problem = torch.arange(len(first), device=first.device) // num_candidates
    # NaN may still draw a picture.
    ranking = evaluate(raw, problem).ranking
    order, place = best_first(ranking.where(finite(raw), torch.inf), problem)
    kept = order[place < num_starts].sort().values
    return {name: tensor[kept] for name, tensor in raw.items()}


def row_seeds(observation: Observation, num_starts: int, seed: int) -> Tensor:
    """Whole numbers (B · num_starts,) that decide each row's random numbers in the optimizer."""
    keys = observation.keys or (0,) * observation.num_problems
    seeds = [mixed_seed(seed, key, f"optimizer/{start}") for key in keys for start in range(num_starts)]
    return torch.tensor(seeds, device=observation.image.device)
