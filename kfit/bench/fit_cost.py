"""What a fit costs: seconds, pictures and memory, and where the time goes."""

from __future__ import annotations

import time
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from kfit.core import FitResult, Observation
from kfit.fitting.pipeline import FitPipeline
from kfit.initializers import Previous
from kfit.runtime.devices import Operations, wait

# What PyTorch's operators do, by a word in their names; the first that fits. The rest is "other".
KINDS = {
    "convolutions": ("conv",),
    "grid sampling": ("grid_sampler",),
    "matrix products": ("mm", "linear"),
    "normalisation": ("norm",),
    "copies": ("copy", "cat", "clone", "index", "fill", "zero"),
}


@dataclass(frozen=True)
class Cost:
    """What one fit took.

    Attributes:
        seconds: on the clock.
        pictures: drawn by the generator.
        megabytes: the most memory that the process (on a GPU: PyTorch) held during the fit; None where the system
            does not report it.
    """

    seconds: float
    pictures: int
    megabytes: float | None


def timed(pipeline: FitPipeline, observation: Observation, seed: int = 0) -> tuple[FitResult, Cost]:
    """Fit once, and what that took.

    Args:
        pipeline: fits.
        observation: on the pipeline's device.
        seed: decides the random numbers.
    """
    device = observation.image.device
    _forget_peak(device)
    wait(device)
    begun = time.perf_counter()
    result = pipeline(observation, seed=seed)
    wait(device)
    spent = time.perf_counter() - begun
    return result, Cost(spent, result.num_evaluations, _peak(device))


def energy_at(pipeline: FitPipeline, observation: Observation, result: FitResult) -> torch.Tensor:
    """Energies (B,) that a pipeline gives to the winners of another fit of the same variables, which it ranks by."""
    names = set(pipeline.generator.variables)
    appearance = FitPipeline(
        pipeline.generator,
        pipeline.terms,
        [Previous(result, on=[name for name in result.values if name in names])],
        pipeline.optimizer,
        weights=pipeline.weights,
        rank_weights=pipeline.rank_weights,
        num_starts=1,
        num_steps=0,
    )
    found: FitResult = appearance(observation, seed=0)
    return found.energy


def profile(pipeline: FitPipeline, observation: Observation) -> dict[str, Any]:
    """Where the time of one fit goes, on the CPU.

    Returns:
        ``seconds`` in all operators, the ``shares`` of it by kind, and ``gflop_per_second`` of the convolutions and
        matrix products, by the operations that they must do.
    """
    from torch.profiler import ProfilerActivity
    from torch.profiler import profile as recorded

    pipeline(observation, seed=0)
    with Operations() as counted:
        pipeline(observation, seed=0)
    with recorded(activities=[ProfilerActivity.CPU]) as found:
        pipeline(observation, seed=0)
    spent: Counter[str] = Counter()
    for event in found.key_averages():
        kind = next((k for k, words in KINDS.items() if any(word in event.key for word in words)), "other")
        spent[kind] += event.self_cpu_time_total / 1e6
    whole, products = sum(spent.values()), spent["convolutions"] + spent["matrix products"]
    return {
        "seconds": whole,
        "shares": {kind: spent[kind] / whole for kind in (*KINDS, "other")},
        "gflop": counted.total / 1e9,
        "gflop_per_second": counted.total / 1e9 / products,
    }


def _forget_peak(device: torch.device) -> None:
    if device.type == "cuda":
        torch.cuda.reset_peak_memory_stats(device)
    else:
        with suppress(OSError):  # Linux alone
            Path("/proc/self/clear_refs").write_text("5")


def _peak(device: torch.device) -> float | None:
    if device.type == "cuda":
        return torch.cuda.max_memory_allocated(device) / 1e6
    with suppress(OSError):
        lines = Path("/proc/self/status").read_text().splitlines()
        return next(float(line.split()[1]) / 1024 for line in lines if line.startswith("VmHWM"))
    return None
