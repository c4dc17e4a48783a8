"""Plain values that a fit passes around: what was seen, what was drawn, where the fit stands."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from typing import Any

import torch
from torch import Tensor
from torch.utils import _pytree as pytree

from kfit.core.check import check_count, check_float, check_shape
from kfit.core.variables import Variables


class _Fields:
    """Reading by name and mapping over the tensors that are there."""

    def field(self, name: str) -> Tensor:
        """The tensor of that name.

        Raises:
            ValueError: if there is no such field, or it is empty.
        """
        there = [f.name for f in fields(self) if isinstance(getattr(self, f.name), Tensor)]  # type: ignore[arg-type]
        if name not in there:
            raise ValueError(f"{type(self).__name__.lower()} has no {name!r}; it has {', '.join(there)}")
        tensor: Tensor = getattr(self, name)
        return tensor

    def select(self, on: str | tuple[str, ...]) -> Any:
        """What an energy on ``on`` compares: one field's tensor, or a dict of several."""
        return self.field(on) if isinstance(on, str) else {name: self.field(name) for name in on}

    def map(self, function: Callable[[Tensor], Tensor]) -> Any:
        """The same with ``function`` applied to each tensor."""
        held = {f.name: getattr(self, f.name) for f in fields(self)}  # type: ignore[arg-type]
        return replace(self, **{k: function(v) for k, v in held.items() if isinstance(v, Tensor)})  # type: ignore[type-var]


@dataclass(frozen=True)
class Observation(_Fields):
    """B pictures to be explained, of as many problems or, with V views, of B / V.

    The V pictures of a problem stand one after another, and a fit explains them all by one set of values. Volumes have
    an axis D before H in all fields.

    Attributes:
        image: (B, C, H, W), RGB in [0, 1] on white background.
        mask: (B, 1, H, W) in [0, 1], 1 on the object.
        depth: (B, 1, H, W) in metres, NaN where it is unknown.
        weight: (B, 1, H, W), 0 where a pixel does not count (occluded or unknown).
        intrinsics: (B, 3, 3) of the picture given.
        trans_cam_ref: (B, 4, 4), takes points in the camera of the problem's first picture to this picture's camera,
            metres and OpenCV's axes.
        keys: one number a problem; with the seed it decides the problem's random numbers. The same key gives the
            same numbers alone and in any batch; all keys are 0 unless given.
        views: V, the number of pictures of each problem.

    Raises:
        TypeError, ValueError: naming the field whose type or shape is wrong.
    """

    image: Tensor
    mask: Tensor | None = None
    depth: Tensor | None = None
    weight: Tensor | None = None
    intrinsics: Tensor | None = None
    keys: tuple[int, ...] = ()
    trans_cam_ref: Tensor | None = None
    views: int = 1

    def __post_init__(self) -> None:
        volume = isinstance(self.image, Tensor) and self.image.dim() == 5
        check_shape("image", self.image, ("B", "C", *("DHW" if volume else "HW")))
        check_float("image", self.image)
        rows, _, *size = self.image.shape
        for name in ("mask", "depth", "weight"):
            if getattr(self, name) is not None:
                check_shape(name, getattr(self, name), (rows, 1, *size))
                if name in ("mask", "depth"):
                    check_float(name, getattr(self, name))
        if self.intrinsics is not None:
            check_shape("intrinsics", self.intrinsics, (rows, 3, 3))
        if self.trans_cam_ref is not None:
            check_shape("trans_cam_ref", self.trans_cam_ref, (rows, 4, 4))
        check_count("views", self.views)
        if rows % self.views:
            raise ValueError(f"image must hold {self.views} views of each problem, got {rows} pictures")
        if self.keys and len(self.keys) != self.num_problems:
            raise ValueError(
                f"keys must hold one number for each of the {self.num_problems} problems, got {len(self.keys)}"
            )

    @property
    def num_problems(self) -> int:
        return self.image.shape[0] // self.views

    def first_views(self) -> Observation:
        """The first picture of each problem alone."""
        if self.views == 1:
            return self
        held = {f.name: getattr(self, f.name) for f in fields(self)}
        first = {name: value[:: self.views] for name, value in held.items() if isinstance(value, Tensor)}
        return replace(self, **first, views=1)  # type: ignore[arg-type]


@dataclass(frozen=True)
class Rendering(_Fields):
    """N drawn pictures.

    Attributes:
        image: (N, C, H, W), RGB in [0, 1] on white background.
        mask: (N, 1, H, W) in [0, 1], where the generator can say.
        depth: (N, 1, H, W), distance behind the object's centre in box diagonals, where the generator can say.
        weight: (N, 1, H, W) in [0, 1], 0 where the generator does not vouch for the pixel, such as outside a warped
            picture; None vouches for all. A fit multiplies it with the observation's weight, see `kfit.FitPipeline`.
    """

    image: Tensor
    mask: Tensor | None = None
    depth: Tensor | None = None
    weight: Tensor | None = None


@dataclass
class Evaluation:
    """Energies of rows, and what else was asked for.

    Attributes:
        energy: (N,) weighted sum that is descended.
        ranking: (N,) weighted sum by which starts are ranked.
        terms: (N,) each, unweighted.
        values: what the generator saw, (N, \\*shape) each.
        gradient: of the sum of ``energy`` over rows with respect to raw variables, if asked for.
        residuals: (N, M) whose squares sum to ``energy``, if asked for.
        rendering: what was drawn, N pictures.
        observed: fields of the observation for these N pictures, if asked for.
    """

    energy: Tensor
    ranking: Tensor
    terms: dict[str, Tensor]
    values: Variables
    gradient: Variables | None = None
    residuals: Tensor | None = None
    rendering: Rendering | None = None
    observed: dict[str, Tensor] | None = None


@dataclass
class FitState:
    """Where a fit stands: N rows, each one start of one problem.

    Attributes:
        step: number of steps taken.
        num_steps: number of steps planned.
        problem, start: (N,) the row's problem and the number that its start had at the beginning.
        raw: variables as the optimizer walks on them, (N, \\*shape) each.
        values: the same as the generator saw them at the last evaluation.
        energy: (N,) descended energy at the last evaluation.
        terms: (N,) each, the unweighted energies by name.
        best_energy, best_values: least ranking energy so far of each row, and the values that reached it.
        optimizer: memory of the optimizer, a pytree whose tensors lead with rows.
        notes: what callbacks remember of the rows, (N, …) each by a name of theirs; so they hold nothing themselves.
        frozen_rows: rows that have stopped moving and still may win; see `freeze`.
    """

    step: int
    num_steps: int
    problem: Tensor
    start: Tensor
    raw: Variables
    values: Variables
    energy: Tensor
    terms: dict[str, Tensor]
    best_energy: Tensor
    best_values: Variables
    optimizer: Any
    notes: dict[str, Tensor] = field(default_factory=dict)
    frozen_rows: tuple[FitState, ...] = ()

    def keep(self, index: Tensor) -> FitState:
        """The same state with the rows of ``index`` (long or boolean) only; start numbers survive."""
        if index.dtype == torch.bool:
            index = index.nonzero()[:, 0]
        held = {f.name: getattr(self, f.name) for f in fields(self)}
        kept = pytree.tree_map_only(Tensor, lambda tensor: tensor.index_select(0, index), held)
        return FitState(**kept)

    def freeze(self, rows: Tensor) -> FitState:
        """The state without these rows (N,), boolean, which cost nothing from now on and stay among the answers."""
        if not bool(rows.any()):
            return self
        return replace(self.keep(~rows), frozen_rows=(*self.frozen_rows, replace(self.keep(rows), frozen_rows=())))
