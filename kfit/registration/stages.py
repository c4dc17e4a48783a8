"""The levels of a registration: the motion of each, and its starts."""

from __future__ import annotations

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor

from kfit.core import FitResult, Initializer, Variables
from kfit.generators import Template, VolumeTemplate
from kfit.generators.motions import BENDING, Motion, pixel_grid, values_of
from kfit.generators.volume_motions import volume_values_of
from kfit.initializers import Constant, Previous
from kfit.registration.pair import Pair
from kfit.registration.starts import FixedStarts, candidate_matrices, random_motions, random_volume_matrices

NUM_RANDOM, NUM_STARTS = 61, 16


@dataclass(frozen=True)
class Stage:
    """State between levels: motion, template and result, or the first starts; and candidate matrices."""

    motion: Motion
    template: Template | VolumeTemplate
    result: FitResult | None
    candidates: Tensor
    starts: tuple[Initializer, ...] = ()
    num_candidates: int = 1
    num_starts: int = 1


def motions_of(motion: Motion, count: int) -> list[Motion]:
    """Return the motion of each level: at most a similarity at the coarsest, then one affine before non-rigid ones."""
    simple: Motion = motion if motion in ("translation", "euclidean") else "similarity"
    ladder: list[Motion] = [simple, "affine"] if motion in BENDING else [simple]
    ladder = ladder[: max(0, count - 1)]
    return [*ladder, *[motion] * (count - len(ladder))]


def first_stage(
    pair: Pair, template: Template | VolumeTemplate, kind: Motion, initial: Tensor | None, seed: int
) -> Stage:
    """Return the starts at the coarsest level."""
    masks = (pair.moving_mask, pair.fixed_mask)
    matrices = (
        candidate_matrices(pair.moving, pair.fixed, masks) if initial is None else initial[:, None].to(pair.fixed)
    )
    first = matrices
    if initial is None and isinstance(template, VolumeTemplate):
        random_ones = random_volume_matrices(NUM_RANDOM, pair.size, seed).to(matrices)
        first = torch.cat([matrices, random_ones.expand(len(matrices), -1, -1, -1)], 1)
    values = _start_values(kind, template, first, pair.size)
    if initial is None and isinstance(template, Template):
        random = random_motions({name: value[:, 0] for name, value in values.items()}, NUM_RANDOM, seed)
        values = {name: torch.cat([value, random[name]], 1) for name, value in values.items()}
    count = next(iter(values.values())).shape[1]
    starts = (FixedStarts(values), *_light_starts(template, None))
    return Stage(kind, template, None, matrices, starts, count, min(NUM_STARTS, count))


def next_stage(state: Stage, template: Template | VolumeTemplate, kind: Motion, pair: Pair) -> Stage:
    """Return the starts at the next level: the last answer and, if the motion changes, the first candidates."""
    result = state.result
    assert result is not None  # the first level was fitted
    light = _light_starts(template, result)
    moving = {name: result.values[name] for name in state.template.moving}
    if kind == state.motion and kind not in BENDING:
        starts: Initializer = FixedStarts({name: value[:, None] for name, value in moving.items()})
        return Stage(kind, template, None, state.candidates, (starts, *light))
    if state.motion in BENDING and isinstance(template, Template):  # more control points
        field = F.interpolate(moving["displacement"], template.control, mode="bicubic", align_corners=True)
        return Stage(kind, template, None, state.candidates, (FixedStarts({"displacement": field[:, None]}), *light))
    size = state.template.size
    to_full = _scaling(size, pair.size, state.candidates)
    found = to_full @ state.template.matrix(**moving) @ torch.linalg.inv(to_full)
    matrices = torch.cat([found[:, None], state.candidates], 1)
    starts = FixedStarts(_start_values(kind, template, matrices, pair.size))
    return Stage(kind, template, None, state.candidates, (starts, *light), matrices.shape[1], min(2, matrices.shape[1]))


def _start_values(
    kind: Motion, template: Template | VolumeTemplate, matrices: Tensor, size: tuple[int, ...]
) -> Variables:
    """Return values (B, S, \\*shape) of a motion for full-size maps of pixels (B, S, 3, 3) or (B, S, 4, 4)."""
    flat = matrices.flatten(0, 1)
    if isinstance(template, VolumeTemplate):
        values = volume_values_of(kind, flat, size)
    elif kind in BENDING:
        # Displacements have the inverse direction: a control point's position in the moving picture minus its own.
        rows, columns = template.control
        points = pixel_grid(flat, (rows, columns)) * flat.new_tensor([size[1] - 1, size[0] - 1])
        points = (points / flat.new_tensor([columns - 1, rows - 1])).view(1, -1, 2)
        inverse = torch.linalg.inv(flat)
        read = points @ inverse[:, :2, :2].mT + inverse[:, None, :2, 2]
        away = (read - points) / flat.new_tensor([size[1] / 2, size[0] / 2])
        values = {"displacement": away.mT.reshape(-1, 2, rows, columns)}
    else:
        values = values_of(kind, flat, (size[0], size[1]))
    return {name: value.unflatten(0, matrices.shape[:2]) for name, value in values.items()}


def _light_starts(template: Template | VolumeTemplate, before: FitResult | None) -> list[Initializer]:
    if "gain" not in template.variables:
        return []
    if before is None:
        return [Constant({"gain": 1.0, "bias": 0.0})]
    return [Previous(before, on=["gain", "bias"])]


def _scaling(small: tuple[int, ...], large: tuple[int, ...], like: Tensor) -> Tensor:
    """Return the map of pixels (3, 3), or of voxels (4, 4), from a picture to its version of another size."""
    times = like.new_tensor([to / side for to, side in zip(large[::-1], small[::-1], strict=True)])
    matrix = torch.cat([times, times.new_ones(1)]).diag()
    matrix[:-1, -1] = (times - 1) / 2
    return matrix
