"""What was observed and what was drawn: pictures with their masks, depths and weights."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, Self

import torch
from torch import Tensor
from torch.utils import _pytree as pytree

from kfit.core.check import check_count, check_float, check_shape
from kfit.core.rows import pictures_of


@dataclass(frozen=True)
class _Fields:
    """Reading by name and mapping over the tensors that are there."""

    def field(self, name: str) -> Tensor:
        """The tensor of that name.

        Raises:
            ValueError: if there is no such field, or it is empty.
        """
        there = [f.name for f in fields(self) if isinstance(getattr(self, f.name), Tensor)]
        if name not in there:
            raise ValueError(f"{type(self).__name__.lower()} has no {name!r}; it has {', '.join(there)}")
        tensor: Tensor = getattr(self, name)
        return tensor

    def select(self, on: str | tuple[str, ...]) -> Any:
        """What an energy on ``on`` compares: one field's tensor, or a dict of several."""
        return self.field(on) if isinstance(on, str) else {name: self.field(name) for name in on}

    def map(self, function: Callable[[Tensor], Tensor]) -> Self:
        """The same with ``function`` applied to each tensor."""
        held = {f.name: getattr(self, f.name) for f in fields(self)}
        return replace(self, **pytree.tree_map_only(Tensor, function, held))


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
        predictions: (problems, …) each by a name of its own, what networks predict of the pictures; parts that need
            such a prediction find it here and do not run the network again, see
            `kfit.geometry.PoseNetwork.log_probabilities`.

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
    predictions: Mapping[str, Tensor] = field(default_factory=dict)

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
        for name, prediction in self.predictions.items():
            if len(prediction) != self.num_problems:
                raise ValueError(
                    f"predictions: {name} must lead with the {self.num_problems} problems, got {len(prediction)}"
                )

    @property
    def num_problems(self) -> int:
        return self.image.shape[0] // self.views

    def __getitem__(self, problems: int | slice | Sequence[int] | Tensor) -> Observation:
        """The problems of these numbers, with all their views and keys.

        >>> Observation(torch.rand(4, 3, 8, 8), keys=(5, 6, 7, 8))[1:3].keys
        (6, 7)
        """
        every = torch.arange(self.num_problems, device=self.image.device)
        chosen = every[[problems] if isinstance(problems, int) else problems]
        return self._taken(pictures_of(chosen, self.views), chosen, self.views)

    @staticmethod
    def cat(observations: Sequence[Observation]) -> Observation:
        """The problems of several observations, of the same fields and views, one after another.

        Keys are kept where all have some.

        Raises:
            ValueError: if one has a field that another lacks, or another number of views.
        """
        first = observations[0]
        joined: dict[str, Any] = {"views": first.views}
        if any(one.views != first.views for one in observations):
            raise ValueError(f"observations must have {first.views} views each, got {[o.views for o in observations]}")
        for name in (f.name for f in fields(first) if f.name not in ("keys", "views", "predictions")):
            there = [getattr(one, name) for one in observations]
            if any((tensor is None) != (there[0] is None) for tensor in there):
                raise ValueError(f"observations must all have a {name}, or none of them")
            joined[name] = None if there[0] is None else torch.cat(there)
        if all(one.keys for one in observations):
            joined["keys"] = tuple(key for one in observations for key in one.keys)
        known = [name for name in first.predictions if all(name in one.predictions for one in observations)]
        predictions = {name: torch.cat([one.predictions[name] for one in observations]) for name in known}
        return Observation(**joined, predictions=predictions)

    def first_views(self) -> Observation:
        """The first picture of each problem alone."""
        if self.views == 1:
            return self
        every = torch.arange(self.num_problems, device=self.image.device)
        return self._taken(every * self.views, every, 1)

    def _taken(self, pictures: Tensor, problems: Tensor, views: int) -> Observation:
        bare = replace(self, keys=(), views=1, predictions={})
        taken = bare.map(lambda tensor: tensor[pictures])
        keys = tuple(self.keys[number] for number in problems.tolist()) if self.keys else ()
        predictions = {name: tensor[problems] for name, tensor in self.predictions.items()}
        return replace(taken, keys=keys, views=views, predictions=predictions)


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
