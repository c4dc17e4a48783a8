"""Optimizers of torch.optim, and others with the same interface."""

from __future__ import annotations

import inspect
from typing import Any

import torch
from torch import Tensor

from kfit.core import Evaluate, Evaluation, Optimizer, Schedule, Variables
from kfit.core.arguments import check_arguments
from kfit.core.check import check_dict, check_names, check_positive, check_range


class TorchOptimizer(Optimizer):
    """Wrap an optimizer class with the interface of `torch.optim`, for each row independently.

    Each row of each variable is a parameter. The optimizer's state of its parameters is stored in tensors that lead
    with rows, so that a fit can prune. In a curved space the step is the optimizer's change of the raw numbers.

    Args:
        optimizer: the class, such as ``torch.optim.AdamW``.
        lr: learning rate, one for all variables or one for each, in raw units (half-turns for angles).
        schedule: factor of the learning rates over the first ``num_steps`` steps; constant by default.
        num_steps: steps over which the schedule runs; it stays at its end afterwards.
        settings: other arguments of the class, such as ``{"weight_decay": 0.01}``.

    Raises:
        TypeError: if ``optimizer`` is not a class of torch optimizers, needs a closure (for L-BFGS there is
            `kfit.optimizers.LBFGS`), or keeps state outside of its parameters' state.
        ValueError: if a learning rate is not above 0 or, when a fit starts, the names differ from the generator's
            variables or the optimizer mixes its parameters, which would mix rows.

    Example:
        Register a blob that moved 3 of 32 pixels to the right, 3/16 of the half-width:

        >>> import torch, kfit
        >>> from kfit.energies import L2
        >>> from kfit.fitting import Cosine
        >>> from kfit.generators import Template
        >>> from kfit.initializers import Constant
        >>> from kfit.optimizers import TorchOptimizer
        >>> x = torch.linspace(-4, 4, 32)
        >>> blob = torch.exp(-x.square() - x[:, None].square())[None]
        >>> start = [Constant({"shift": 0.0})]
        >>> optimizer = TorchOptimizer(torch.optim.AdamW, lr=0.02, schedule=Cosine(1.0, 0.0))
        >>> fit = kfit.FitPipeline(Template(blob, "translation"), {"l2": L2()}, start, optimizer, num_starts=1)
        >>> fit(kfit.Observation(blob.roll(3, 2)[None]), seed=0).values["shift"][0, 0].round(decimals=2)
        tensor(0.1900)
    """

    def __init__(
        self,
        optimizer: type[torch.optim.Optimizer],
        lr: float | dict[str, float],
        schedule: Schedule | None = None,
        num_steps: int = 50,
        settings: dict[str, Any] | None = None,
    ) -> None:
        if not (isinstance(optimizer, type) and issubclass(optimizer, torch.optim.Optimizer)):
            raise TypeError(f"TorchOptimizer: optimizer must be a class like torch.optim.AdamW, got {optimizer!r:.80}")
        closure = inspect.signature(optimizer.step).parameters.get("closure")
        if closure is not None and closure.default is inspect.Parameter.empty:
            raise TypeError(
                f"TorchOptimizer: {optimizer.__name__} needs a closure, which fits cannot give; "
                "for L-BFGS use kfit.optimizers.LBFGS"
            )
        if isinstance(lr, dict):
            check_dict("TorchOptimizer: lr", lr, check_range, 0)  # 0 holds a variable
        else:
            check_positive("TorchOptimizer: lr", lr)
        if schedule is not None and not isinstance(schedule, Schedule):
            raise TypeError(f"TorchOptimizer: schedule must be a kfit.core.Schedule, got {type(schedule).__name__}")
        check_arguments(TorchOptimizer, locals())
        self.optimizer, self.lr, self.schedule, self.num_steps = optimizer, lr, schedule, num_steps
        self.options = dict(settings or {})

    def init(self, raw: Variables, seeds: Tensor) -> Any:
        if isinstance(self.lr, dict):
            check_names("lr", self.lr, raw, complete=True)
        self._check_independence(raw)
        return {"count": torch.zeros_like(seeds), "state": {name: {} for name in raw}, "homes": {}}

    def step(
        self, evaluate: Evaluate, raw: Variables, problem: Tensor, memory: Any
    ) -> tuple[Variables, Evaluation, Any]:
        evaluation = evaluate(raw, problem, need="gradient")
        step, memory = self._step(raw, evaluation.gradient, memory)
        return evaluate.retract(raw, step), evaluation, memory

    def _step(self, raw: Variables, gradient: Variables, memory: Any) -> tuple[Variables, Any]:
        # All rows of a fit have taken the same number of steps.
        taken = min(int(memory["count"][0]), self.num_steps) if len(memory["count"]) else 0
        factor = 1.0 if self.schedule is None else self.schedule(taken, self.num_steps)
        lr = self.lr if isinstance(self.lr, dict) else dict.fromkeys(raw, self.lr)
        # Unbound, each row is a separate tensor. Without rows the optimizer could not be built.
        rows = {name: list(tensor.detach().clone().unbind()) for name, tensor in raw.items()}
        if not len(memory["count"]):
            return {name: torch.zeros_like(tensor) for name, tensor in raw.items()}, memory
        groups = [{"params": rows[name], "lr": lr[name] * factor} for name in raw]
        optimizer = self.optimizer(groups, **self.options)
        for name in raw:
            for number, (row, slope) in enumerate(zip(rows[name], gradient[name].unbind(), strict=True)):
                row.grad = slope.to(row)
                held, homes = memory["state"][name], memory["homes"]
                if held:
                    optimizer.state[row] = {k: _unpacked(v, homes[k], number) for k, v in held.items()}
        before = _settings_of(optimizer)
        optimizer.step()
        if _settings_of(optimizer) != before:
            raise TypeError(
                f"TorchOptimizer: {self.optimizer.__name__} remembers something in its parameter groups, not in its "
                "parameters' state, which no row could keep for itself"
            )
        states = {name: [optimizer.state[row] for row in rows[name]] for name in raw}
        homes = {key: _home(value) for first in states.values() for key, value in first[0].items()}
        state = {
            name: {key: _packed([s[key] for s in held], raw[name]) for key in held[0]} for name, held in states.items()
        }
        moved = {name: torch.stack(rows[name]) - tensor for name, tensor in raw.items()}
        return moved, {"count": memory["count"] + 1, "state": state, "homes": homes}

    def _check_independence(self, raw: Variables) -> None:
        """Refuse an optimizer whose step of one row depends on the other rows."""
        rng = torch.Generator().manual_seed(0)
        two = {name: torch.randn(2, *t.shape[1:], generator=rng, dtype=torch.float64) for name, t in raw.items()}
        one = {name: tensor[:1] for name, tensor in two.items()}
        ends = []
        for place in (two, one):
            rows = len(next(iter(place.values())))
            memory = {"count": torch.zeros(rows), "state": {name: {} for name in place}, "homes": {}}
            for _ in range(2):
                slopes = {name: tensor - 1 for name, tensor in place.items()}
                step, memory = self._step(place, slopes, memory)
                place = {name: tensor + step[name] for name, tensor in place.items()}
            ends.append({name: tensor[:1] for name, tensor in place.items()})
        if any(not torch.allclose(ends[0][name], ends[1][name], rtol=1e-9) for name in raw):
            raise ValueError(f"TorchOptimizer: {self.optimizer.__name__} mixes its parameters, and so would mix rows")


def _settings_of(optimizer: torch.optim.Optimizer) -> list[dict[str, Any]]:
    return [{k: v for k, v in group.items() if k != "params"} for group in optimizer.param_groups]


def _home(value: Any) -> str:
    """Return where a stored value was: a tensor's device, or "int" or "float"."""
    return str(value.device) if isinstance(value, Tensor) else type(value).__name__


def _packed(values: list[Any], like: Tensor) -> Any:
    """Stack the values that rows store under one name to one tensor that leads with rows; other types stay."""
    if isinstance(values[0], Tensor):
        return torch.stack(values).to(like.device)
    if isinstance(values[0], int | float):
        return torch.tensor(values, dtype=torch.float64).to(like.device)
    return values[0]


def _unpacked(packed: Any, home: str, row: int) -> Any:
    """Return one row's value of `_packed`."""
    if not isinstance(packed, Tensor):
        return packed
    own = packed[row].clone()
    return int(own) if home == "int" else float(own) if home == "float" else own.to(home)
