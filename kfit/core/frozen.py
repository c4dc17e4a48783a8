"""A network's twin that shares its numbers and asks for no gradients."""

from __future__ import annotations

import copy
from typing import Any, TypeVar

from torch import nn

Module = TypeVar("Module", bound=nn.Module)


def frozen(module: Module) -> Module:
    """A twin of ``module`` in evaluation mode whose parameters are detached.

    The twin shares memory with the original: it costs nothing, sees later training of it, and leaves its
    ``requires_grad`` flags and its mode alone, so a fit never disturbs a network in training and threads can share it.
    """
    shared: dict[int, Any] = {id(p): nn.Parameter(p.detach(), requires_grad=False) for p in module.parameters()}
    shared.update({id(b): b for b in module.buffers()})
    return copy.deepcopy(module, shared).eval()
