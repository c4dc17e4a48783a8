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
    """Access to fields by name, and maps over the tensors among them."""

    def field(self, name: str) -> Tensor:
        """Return the tensor of that name.

        Raises:
            ValueError: if there is no such field, or it is None.
        """
        there = [f.name for f in fields(self) if isinstance(getattr(self, f.name), Tensor)]
        if name not in there:
            raise ValueError(f"{type(self).__name__.lower()} has no {name!r}; it has {', '.join(there)}")
        tensor: Tensor = getattr(self, name)
        return tensor

    def select(self, on: str | tuple[str, ...]) -> Any:
        """Return the input of an energy on ``on``: one tensor, or a dict of several."""
        return self.field(on) if isinstance(on, str) else {name: self.field(name) for name in on}

    def map(self, function: Callable[[Tensor], Tensor]) -> Self:
        """Return a copy with ``function`` applied to each tensor."""
        held = {f.name: getattr(self, f.name) for f in fields(self)}
        return replace(self, **pytree.tree_map_only(Tensor, function, held))


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
        predictions: (problems, …) each by a name of its own, what networks predict of the pictures; parts that need
            such a prediction find it here and do not run the network again, see
            `kfit.geometry.PoseNetwork.log_probabilities`.

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
        """Number of problems, B / V."""
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
        """Return the first picture of each problem."""
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
