"""Plain values that a fit passes between its parts: observation, rendering, evaluation, state."""

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
    """Access to fields by name, and maps over the tensors among them."""

    def field(self, name: str) -> Tensor:
        """Return the tensor of that name.

        Raises:
            ValueError: if there is no such field, or it is None.
        """
        there = [f.name for f in fields(self) if isinstance(getattr(self, f.name), Tensor)]  # type: ignore[arg-type]
        if name not in there:
            raise ValueError(f"{type(self).__name__.lower()} has no {name!r}; it has {', '.join(there)}")
        tensor: Tensor = getattr(self, name)
        return tensor

    def select(self, on: str | tuple[str, ...]) -> Any:
        """Return the input of an energy on ``on``: one tensor, or a dict of several."""
        return self.field(on) if isinstance(on, str) else {name: self.field(name) for name in on}

    def map(self, function: Callable[[Tensor], Tensor]) -> Any:
        """Return a copy with ``function`` applied to each tensor."""
        held = {f.name: getattr(self, f.name) for f in fields(self)}  # type: ignore[arg-type]
        return replace(self, **{k: function(v) for k, v in held.items() if isinstance(v, Tensor)})  # type: ignore[type-var]


@dataclass(frozen=True)
class Observation(_Fields):
    """B observed pictures of B problems or, with V views each, of B / V problems.

    The V pictures of a problem are consecutive, and a fit explains them by one set of values. Volumes have an axis D
    before H in all fields.

    Attributes:
        image: (B, C, H, W), RGB in [0, 1] on white background.
        mask: (B, 1, H, W) in [0, 1], 1 on the object.
        depth: (B, 1, H, W) in metres, NaN where unknown.
        weight: (B, 1, H, W), at least 0; 0 excludes a pixel (occluded or unknown).
        intrinsics: (B, 3, 3) of these pictures.
        trans_cam_ref: (B, 4, 4), maps points in the camera of the problem's first picture to this picture's camera,
            metres and OpenCV's axes.
        keys: one number for each problem. With the seed it determines the problem's random numbers: the same key gives
            the same numbers alone and in any batch. All keys are 0 by default.
        views: V, the number of pictures of each problem.

    Raises:
        TypeError, ValueError: naming the field whose type or shape is wrong.

    Example:
        >>> import torch
        >>> from kfit.core import Observation
        >>> observation = Observation(torch.rand(4, 3, 64, 64), mask=torch.ones(4, 1, 64, 64), views=2)
        >>> observation.num_problems
        2
        >>> observation.field("depth")
        Traceback (most recent call last):
        ValueError: observation has no 'depth'; it has image, mask
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
        """Number of problems, B / V."""
        return self.image.shape[0] // self.views

    def first_views(self) -> Observation:
        """Return the first picture of each problem."""
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
        mask: (N, 1, H, W) in [0, 1], if the generator draws it.
        depth: (N, 1, H, W), distance behind the object's centre in box diagonals, if the generator draws it.
        weight: (N, 1, H, W) in [0, 1], 0 where the picture is not known, such as outside of a warped picture; None is 1
            everywhere. A fit multiplies it with the observation's weight, see `kfit.FitPipeline`.

    Example:
        >>> import torch
        >>> from kfit.core import Rendering
        >>> rendering = Rendering(torch.ones(2, 3, 8, 8), mask=torch.zeros(2, 1, 8, 8))
        >>> rendering.map(lambda tensor: tensor[:1]).image.shape
        torch.Size([1, 3, 8, 8])
    """

    image: Tensor
    mask: Tensor | None = None
    depth: Tensor | None = None
    weight: Tensor | None = None


@dataclass
class Evaluation:
    """Energies of N rows, and on request their derivatives.

    Attributes:
        energy: (N,) weighted sum that the optimizer minimises.
        ranking: (N,) weighted sum by which starts are ranked.
        terms: (N,) each, unweighted.
        values: the generator's inputs, (N, \\*shape) each.
        gradient: of the sum of ``energy`` over rows with respect to raw variables, if requested.
        residuals: (N, M) whose squares sum to ``energy``, if requested.
        rendering: the N drawn pictures.
        observed: fields of the observation for these N pictures, if requested.
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
    """State of a fit: N rows, each one start of one problem.

    Attributes:
        step: number of steps taken.
        num_steps: number of steps planned.
        problem, start: (N,) the row's problem and the original number of its start.
        raw: raw variables, which the optimizer moves, (N, \\*shape) each.
        values: the generator's inputs at the last evaluation.
        energy: (N,) minimised energy at the last evaluation.
        terms: (N,) each, the unweighted energies by name.
        best_energy, best_values: least ranking energy so far of each row, and its values.
        optimizer: memory of the optimizer, a pytree whose tensors lead with rows.
        notes: data of callbacks about the rows, (N, …) each by a name of their choice, so that callbacks are stateless.
        frozen_rows: rows that no longer move and can still win; see `freeze`.

    Example:
        A callback that keeps the best half of all rows:

        >>> import kfit
        >>> class BestHalf(kfit.Callback):
        ...     def on_step(self, state: kfit.FitState) -> kfit.FitState:
        ...         return state.keep(state.best_energy <= state.best_energy.median())
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
        """Return the state with the rows of ``index`` (long or boolean) only; start numbers are kept."""
        if index.dtype == torch.bool:
            index = index.nonzero()[:, 0]
        held = {f.name: getattr(self, f.name) for f in fields(self)}
        kept = pytree.tree_map_only(Tensor, lambda tensor: tensor.index_select(0, index), held)
        return FitState(**kept)

    def freeze(self, rows: Tensor) -> FitState:
        """Return the state without these rows (N,), boolean, which cost nothing from now on and can still win."""
        if not bool(rows.any()):
            return self
        return replace(self.keep(~rows), frozen_rows=(*self.frozen_rows, replace(self.keep(rows), frozen_rows=())))
