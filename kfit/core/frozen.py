"""A network's twin that shares its numbers and asks for no gradients."""

from __future__ import annotations

import copy
from typing import Any, TypeVar

import torch
from torch import Tensor, nn
from torch.utils import _pytree as pytree

from kfit.core.part import Part

Module = TypeVar("Module", bound=nn.Module)
OnePart = TypeVar("OnePart", bound=Part)


def frozen(module: Module) -> Module:
    """A twin of ``module`` in evaluation mode whose parameters are detached.

    The twin shares memory with the original: it costs nothing, sees later training of it, and leaves its
    ``requires_grad`` flags and its mode alone, so a fit never disturbs a network in training and threads can share it.
    What was made in inference mode is copied instead, so that gradients can pass through the twin.
    """
    with torch.inference_mode(False):
        shared: dict[int, Any] = {
            id(p): nn.Parameter(_fit_for_gradients(p.detach()), requires_grad=False) for p in module.parameters()
        }
        shared.update({id(b): _fit_for_gradients(b) for b in module.buffers()})
        return copy.deepcopy(module, shared).eval()


def with_frozen_networks(part: OnePart) -> OnePart:
    """A copy of a part that is no network itself, with `frozen` twins of the networks that its attributes hold."""
    twin = copy.copy(part)
    for name, value in vars(part).items():
        if name != "settings":
            vars(twin)[name] = pytree.tree_map_only(nn.Module, frozen, value)
    return twin


def networks_of(part: Part) -> list[nn.Module]:
    """Networks that the attributes of a part hold, also in lists, tuples and dicts."""
    held = [value for name, value in vars(part).items() if name != "settings"]
    return [leaf for leaf in pytree.tree_leaves(held) if isinstance(leaf, nn.Module)]


def _fit_for_gradients(tensor: Tensor) -> Tensor:
    """The tensor, or a copy of one that was made in inference mode, which autograd refuses."""
    return tensor.clone() if tensor.is_inference() else tensor
