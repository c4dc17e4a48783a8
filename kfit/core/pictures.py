"""Checks, precision and reduction that all energies share."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from typing import Any, Literal

import torch
from torch import Tensor
from torch.utils import _pytree as pytree

from kfit.core.check import check_choice, check_names, check_shape

Reduction = Literal["none", "mean", "sum"]
# How far a target in [0, 1] may overshoot, as interpolated pictures do.
OVERSHOOT = 0.5


def check_pictures(name: str, pictures: Any, volumes: bool = False, least_side: int = 1) -> None:
    """Refuse anything but a batch of floating-point pictures, or a dict of such.

    Args:
        name: name of the argument.
        pictures: (N, C, H, W).
        volumes: whether (N, C, D, H, W) is accepted too.
        least_side: least number of pixels of each spatial side.

    Raises:
        TypeError: if it is not a tensor, or holds integers.
        ValueError: if it has another number of axes, no rows, or a side that is too short.
    """
    if isinstance(pictures, dict):
        for key, picture in pictures.items():
            check_pictures(f"{name} of {key}", picture, volumes, least_side)
        return
    wanted = "(N, C, H, W)" + (" or (N, C, D, H, W)" if volumes else "")
    if not isinstance(pictures, Tensor):
        raise TypeError(f"{name} must be a tensor of shape {wanted}, got {type(pictures).__name__}")
    came = tuple(pictures.shape)
    if pictures.dim() not in ((4, 5) if volumes else (4,)):
        missing = f"; one picture needs an axis of rows, {name}[None]" if pictures.dim() == 3 else ""
        raise ValueError(f"{name} must have shape {wanted}, got {came}{missing}")
    if not pictures.is_floating_point():
        cure = f": {name}.float() / 255" if pictures.dtype == torch.uint8 else ""
        raise TypeError(f"{name} must be a floating-point tensor in [0, 1], got {pictures.dtype}{cure}")
    if 0 in came[:2]:
        raise ValueError(f"{name} must hold at least one picture of at least one channel, got shape {came}")
    if min(came[2:]) < least_side:
        raise ValueError(f"{name} must be at least {least_side} pixels along each side, got {came[2:]}")


def check_target(target: Any, weight: Tensor | None, volumes: bool, unit_range: bool) -> None:
    """Refuse targets and weights that an energy cannot compare, as `Energy` describes it.

    Raises:
        TypeError, ValueError: naming what was expected and what came.
    """
    check_pictures("target", target, volumes)
    if weight is not None:
        _check_weight(weight, target)
    if unit_range:
        _check_unit_range(target, weight)


def check_prediction(prediction: Any, target: Any, volumes: bool) -> None:
    """Refuse predictions of another shape than their targets, which some networks would compare nevertheless.

    Raises:
        TypeError, ValueError: naming what was expected and what came.
    """
    check_pictures("prediction", prediction, volumes)
    if isinstance(target, dict):
        check_names("prediction", prediction, target, complete=True)
    for name, picture in target.items() if isinstance(target, dict) else [("", target)]:
        drawn = prediction[name] if name else prediction
        check_shape(f"prediction of {name}" if name else "prediction", drawn, tuple(picture.shape))


def _check_weight(weight: Any, pictures: Any) -> None:
    like: Tensor = pytree.tree_leaves(pictures)[0]
    wanted = (like.shape[0], 1, *like.shape[2:])
    if not isinstance(weight, Tensor):
        raise TypeError(f"weight must be a tensor of shape {wanted}, got {type(weight).__name__}")
    if tuple(weight.shape) != wanted:
        raise ValueError(f"weight must have shape {wanted}, got {tuple(weight.shape)}")
    # NaN and infinity make their own row NaN, and do not affect the others.
    counted = weight if weight.dtype == torch.bool else weight.nan_to_num(0, 0, 0)
    if _known_false((counted >= 0).all()):
        raise ValueError(f"weight must be at least 0 everywhere, got {float(counted.min()):g}")


def _check_unit_range(pictures: Any, weight: Tensor | None) -> None:
    """Refuse pictures that lie more than `OVERSHOOT` outside [0, 1] where their weight is above 0."""
    for picture in pytree.tree_leaves(pictures):
        counted = picture if weight is None else torch.where(weight > 0, picture, 0.5)
        low, high = torch.aminmax(counted.detach().nan_to_num(0.5, 0.5, 0.5))
        if _known_false((low >= -OVERSHOOT) & (high <= 1 + OVERSHOOT)):
            cure = ": divide it by 255" if float(high) > 2 else ""
            raise ValueError(f"target must lie in [0, 1], got {float(low):.3g} to {float(high):.3g}{cure}")


def at_least_single(tensors: Any) -> Any:
    """Convert the floating-point tensors of a pytree to at least single precision."""
    return pytree.tree_map_only(
        Tensor, lambda t: t.to(torch.promote_types(t.dtype, torch.float32)) if t.is_floating_point() else t, tensors
    )


def precision_of(tensors: Any, mixed: bool) -> AbstractContextManager[Any]:
    """Return a context that disables autocast on the device of a pytree, or changes nothing if ``mixed``."""
    device = pytree.tree_leaves(tensors)[0].device.type
    return nullcontext() if mixed else torch.autocast(device, enabled=False)


def reduced(energies: Tensor, reduction: Reduction) -> Tensor:
    """Reduce energies (N,) to their mean or sum, or return them unchanged.

    Raises:
        ValueError: if the reduction is unknown.
    """
    check_choice("reduction", reduction, ("none", "mean", "sum"))
    return energies if reduction == "none" else getattr(energies, reduction)()


def _known_false(condition: Tensor) -> bool:
    """Return whether the condition is False; never if its value cannot be read, as under `torch.vmap`."""
    if torch.compiler.is_compiling():
        return False
    try:
        return not bool(condition)
    except RuntimeError:
        return False
