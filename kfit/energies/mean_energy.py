"""Energies as torchmetrics."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor
from torchmetrics import Metric

from kfit.core import Energy


class MeanEnergy(Metric):
    """Mean of an energy over all pictures of all batches and processes, as a metric of torchmetrics.

    It works wherever torchmetrics' metrics do: in a ``MetricCollection``, Lightning's ``self.log`` or a
    ``MetricTracker``. Each picture counts once, whatever its weights hold.

    Args:
        energy: the energy to average; kept as it is.
        kwargs: as `torchmetrics.Metric` takes them.

    Raises:
        TypeError: if ``energy`` is not a `kfit.core.Energy`.

    Example:
        >>> import torch
        >>> from kfit.energies import L1
        >>> from kfit.energies.mean_energy import MeanEnergy
        >>> metric = MeanEnergy(L1())
        >>> metric.update(torch.zeros(1, 3, 4, 4), torch.ones(1, 3, 4, 4))
        >>> metric.update(torch.zeros(3, 3, 4, 4), torch.zeros(3, 3, 4, 4))
        >>> metric.compute()
        tensor(0.2500)
    """

    is_differentiable = True
    higher_is_better = False
    full_state_update = False

    total: Tensor
    count: Tensor

    def __init__(self, energy: Energy, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        if not isinstance(energy, Energy):
            raise TypeError(f"MeanEnergy: energy must be a kfit.core.Energy, got {type(energy).__name__}")
        self.energy = energy
        self.add_state("total", torch.tensor(0.0, dtype=torch.float64), dist_reduce_fx="sum")
        self.add_state("count", torch.tensor(0), dist_reduce_fx="sum")

    def update(self, prediction: Any, target: Any, weight: Tensor | None = None) -> None:
        """Add a batch, as `kfit.core.Energy.forward` takes it."""
        found = self.energy(prediction, target, weight)
        self.total = self.total + found.sum().to(self.total)
        self.count = self.count + len(found)

    def compute(self) -> Tensor:
        """Return the mean so far; NaN before the first batch."""
        return (self.total / self.count).float()
