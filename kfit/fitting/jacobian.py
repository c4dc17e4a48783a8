"""Products with the Jacobian of residuals, in reverse mode only."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor


class JacobianProducts:
    """The `kfit.core.Linearization` of drawn rows: J · step and Jᵀ · residuals, with one backward pass each.

    J · v is the derivative of Jᵀu by u along v ("double backward"), because ``grid_sample`` has no forward mode in
    torch 2.13, while its backward pass is differentiable.

    Args:
        parts: for each chunk of rows the steps (n, \\*raw_shape) by variable, zeros with a graph, and the residuals (n,
            M) there.
    """

    def __init__(self, parts: Sequence[tuple[Sequence[Tensor], Tensor]]) -> None:
        self._parts = list(parts)
        self._pulled: list[tuple[Tensor, list[Tensor]] | None] = [None] * len(self._parts)

    def push(self, step: Tensor) -> Tensor:
        """Return J · step, (N, M), for steps (N, P) of all variables, concatenated."""
        found = []
        for number, rows in enumerate(step.split([len(residuals) for _, residuals in self._parts])):
            held = self._pulled[number]
            if held is None:
                steps, residuals = self._parts[number]
                with torch.enable_grad():
                    dummy = torch.zeros_like(residuals, requires_grad=True)
                    held = self._pulled[number] = (dummy, _gradients(residuals, steps, dummy, create_graph=True))
            dummy, pulled = held
            sizes = [tensor[0].numel() for tensor in pulled]
            along = [part.view_as(tensor) for part, tensor in zip(rows.split(sizes, 1), pulled, strict=True)]
            found.append(_gradients_of(pulled, dummy, along))
        return torch.cat(found)

    def pull(self, residuals: Tensor) -> Tensor:
        """Return Jᵀ · residuals, (N, P), for (N, M)."""
        found = []
        for (steps, drawn), rows in zip(self._parts, residuals.split([len(r) for _, r in self._parts]), strict=True):
            found.append(torch.cat([part.reshape(len(part), -1) for part in _gradients(drawn, steps, rows)], 1))
        return torch.cat(found)


def _gradients(drawn: Tensor, steps: Sequence[Tensor], weights: Tensor, create_graph: bool = False) -> list[Tensor]:
    """Return derivatives of Σ weights · drawn by each step; zeros for steps without effect."""
    if not drawn.requires_grad:
        return [torch.zeros_like(step) for step in steps]
    return list(
        torch.autograd.grad(drawn, steps, weights, retain_graph=True, create_graph=create_graph, materialize_grads=True)
    )


def _gradients_of(pulled: Sequence[Tensor], dummy: Tensor, along: Sequence[Tensor]) -> Tensor:
    """Return derivatives of Σ along · pulled by ``dummy``; zeros if no variable changes a residual."""
    pairs = [(tensor, part) for tensor, part in zip(pulled, along, strict=True) if tensor.requires_grad]
    if not pairs:
        return torch.zeros_like(dummy)
    tensors, parts = zip(*pairs, strict=True)
    (found,) = torch.autograd.grad(tensors, dummy, parts, retain_graph=True, materialize_grads=True)
    return found
