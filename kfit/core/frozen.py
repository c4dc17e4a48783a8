"""A network's twin that shares its numbers and asks for no gradients."""

from __future__ import annotations

import copy
from typing import Any, TypeVar

import torch
from torch import Tensor, nn

Module = TypeVar("Module", bound=nn.Module)


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


def _fit_for_gradients(tensor: Tensor) -> Tensor:
    """The tensor, or a copy of one that was made in inference mode, which autograd refuses."""
    return tensor.clone() if tensor.is_inference() else tensor
