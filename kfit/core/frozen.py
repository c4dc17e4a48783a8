"""A copy of a network that shares its parameters and needs no gradients."""

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
    """Return a copy of ``module`` in evaluation mode whose parameters are detached.

    The copy shares memory with the original: it costs nothing, follows its later training, and leaves its
    ``requires_grad`` flags and its mode unchanged. A fit therefore never disturbs a network in training, and threads
    can share it. Tensors made in inference mode are copied, so that gradients can pass through the copy.

    Example:
        >>> import torch
        >>> from kfit.core import frozen
        >>> network = torch.nn.Linear(2, 1)
        >>> copy = frozen(network)
        >>> copy.weight.requires_grad, network.weight.requires_grad
        (False, True)
        >>> copy.weight.data_ptr() == network.weight.data_ptr()
        True
    """
    with torch.inference_mode(False):
        shared: dict[int, Any] = {
            id(p): nn.Parameter(_fit_for_gradients(p.detach()), requires_grad=False) for p in module.parameters()
        }
        shared.update({id(b): _fit_for_gradients(b) for b in module.buffers()})
        return copy.deepcopy(module, shared).eval()


def with_frozen_networks(part: OnePart) -> OnePart:
    """A copy of a part that is no network itself, with `frozen` twins of the networks that it holds.

    Networks are found in its attributes, in lists, tuples and dicts there, and in parts that it is composed of.
    """
    twin = copy.copy(part)
    vars(twin).update({name: pytree.tree_map(_twin, value) for name, value in _held(part).items()})
    return twin


def networks_of(part: Part) -> list[nn.Module]:
    """Networks that a part holds, where `with_frozen_networks` finds them."""
    found: list[nn.Module] = []
    for leaf in pytree.tree_leaves(_held(part)):
        if isinstance(leaf, nn.Module):
            found.append(leaf)
        elif isinstance(leaf, Part):
            found += networks_of(leaf)
    return found


def _held(part: Part) -> dict[str, Any]:
    return {name: value for name, value in vars(part).items() if name != "settings"}


def _twin(value: Any) -> Any:
    if isinstance(value, nn.Module):
        return frozen(value)
    return with_frozen_networks(value) if isinstance(value, Part) else value


def _fit_for_gradients(tensor: Tensor) -> Tensor:
    """Return the tensor, or a copy if it was made in inference mode, which autograd refuses."""
    return tensor.clone() if tensor.is_inference() else tensor
