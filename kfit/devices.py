"""Where to compute, and in which precision."""

from __future__ import annotations

import shutil
from contextlib import AbstractContextManager
from typing import Any

import torch
from torch import nn


def device_of(name: str) -> torch.device:
    """The device of that name.

    Raises:
        ValueError: if there is none here.
    """
    try:
        device = torch.device(name)
        torch.empty(1, device=device)
    except (RuntimeError, AssertionError) as error:  # PyTorch asserts that it was built with CUDA
        raise ValueError(f"device: {name!r} cannot be used here: {str(error).splitlines()[0]}") from None
    return device


def precision(name: str, device: str | torch.device) -> AbstractContextManager[Any]:
    """Within it fits compute in single precision ("32"), or draw and compare by bfloat16 convolutions ("bf16")."""
    return torch.autocast(torch.device(device).type, torch.bfloat16, enabled=name == "bf16")


def compile_networks(*networks: nn.Module, **kwargs: Any) -> bool:
    """Have networks compiled when they are first used (`torch.compile`), which a CPU needs a C++ compiler for.

    Args:
        networks: all on one device.
        kwargs: as `torch.compile` takes them.

    Returns:
        Whether they will be; where there is no compiler they stay as they are.
    """
    first = next((parameter for network in networks for parameter in network.parameters()), None)
    on_cpu = first is None or first.device.type == "cpu"
    if on_cpu and not any(shutil.which(name) for name in ("c++", "g++", "clang++")):
        return False
    for network in networks:
        network.compile(**kwargs)
    return True
