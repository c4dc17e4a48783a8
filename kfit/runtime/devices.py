"""Where to compute, in which precision, compiled or not, and what the machine can do."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import Any

import torch
from torch import nn
from torch.utils._python_dispatch import TorchDispatchMode

# The process that imported this file.
_FIRST_PROCESS = os.getpid()


def device_of(name: str) -> torch.device:
    """The device of that name.

    Raises:
        ValueError: if this machine has none.
    """
    try:
        device = torch.device(name)
        torch.empty(1, device=device)
    except (RuntimeError, AssertionError) as error:  # PyTorch asserts that it was built with CUDA
        raise ValueError(f"device: {name!r} cannot be used here: {str(error).splitlines()[0]}") from None
    return device


def precision(name: str, device: str | torch.device) -> AbstractContextManager[Any]:
    """Within it fits compute in single precision ("32"), or draw and compare by bfloat16 convolutions ("bf16").

    Raises:
        ValueError: for another name.
    """
    if name not in ("32", "bf16"):
        raise ValueError(f"precision must be '32' or 'bf16', got {name!r}")
    return torch.autocast(torch.device(device).type, torch.bfloat16, enabled=name == "bf16")


def compile_networks(*networks: nn.Module, **kwargs: Any) -> bool:
    """Have networks compiled when they are first used (`torch.compile`), which a CPU needs a C++ compiler for.

    Args:
        networks: all on one device.
        kwargs: as `torch.compile` takes them.

    Returns:
        Whether they will be compiled; without a compiler they are unchanged.
    """
    first = next((parameter for network in networks for parameter in network.parameters()), None)
    on_cpu = first is None or first.device.type == "cpu"
    if on_cpu and not any(shutil.which(name) for name in ("c++", "g++", "clang++")):
        return False
    for network in networks:
        network.compile(**kwargs)
    return True


def cores() -> int:
    """Number of processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def memory() -> int:
    """Return the bytes of the machine's memory, or 64 GB if unknown."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return 64 * 1024**3


def on_one_core(worker: int) -> None:
    """Have one of a `torch.utils.data.DataLoader`'s workers compute with one thread, as there is one a core."""
    import cv2

    cv2.setNumThreads(0)  # with 1 a forked process waits forever for threads that are its parent's


@contextmanager
def one_thread() -> Iterator[None]:
    """Have PyTorch compute with one thread of the CPU in a ``with`` statement, whatever ends it."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


@contextmanager
def safe_after_fork() -> Iterator[None]:
    """Have PyTorch compute with one thread in a ``with`` statement or decorated function, in a forked process only.

    There the first operation that wants more would wait forever for OpenMP's threads, which are the parent's.
    """
    with nullcontext() if os.getpid() == _FIRST_PROCESS else one_thread():
        yield


class Operations(TorchDispatchMode):
    """Counts the floating point operations of convolutions and matrix products that run within it.

    PyTorch's own ``FlopCounterMode`` follows modules too, for which gradients must not be asked by
    ``torch.autograd.grad``.

    Attributes:
        total: so far.
    """

    def __init__(self) -> None:
        super().__init__()
        from torch.utils.flop_counter import flop_registry  # takes a while to import

        self._registry, self.total = flop_registry, 0

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        out = func(*args, **(kwargs or {}))
        count = self._registry.get(func.overloadpacket)
        if count is not None:
            self.total += count(*args, **(kwargs or {}), out_val=out)
        return out


def wait(device: str | torch.device) -> None:
    """Wait until a GPU has finished its work; a CPU is synchronous."""
    if torch.device(device).type == "cuda":
        torch.cuda.synchronize(device)


def matrix_rate(
    dtype: torch.dtype, device: str | torch.device = "cpu", size: int | None = None, repeats: int = 5
) -> float:
    """GFLOP a second of products of square matrices, the best of several: what the machine can do.

    Args:
        dtype: data type of the matrices.
        device: device on which they are multiplied.
        size: side length of the matrices; by default 2048, on a GPU 8192.
        repeats: products that count.
    """
    size = size or (2048 if torch.device(device).type == "cpu" else 8192)
    left, right = (torch.randn(size, size, device=device).to(dtype) for _ in range(2))
    best = 0.0
    for _ in range(repeats + 1):
        wait(device)
        begun = time.perf_counter()
        left @ right
        wait(device)
        best = max(best, 2 * size**3 / (time.perf_counter() - begun) / 1e9)
    return best
