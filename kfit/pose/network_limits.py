"""Limits on the size of a network that is read from an untrusted file; networks built in code have no limit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import torch
from torch import nn
from torch.overrides import TorchFunctionMode

from kfit.core.check import check_count

# Of any size that a card names; layers by the name of the argument that lists their widths, each of which doubles what
# is drawn; pixels a side of a picture, and samples of volume rendering in one.
LARGEST_SIZE = 4096
MOST_LAYERS = {"volume_dims": 6}
MOST_LAYERS_ELSEWHERE = 9
LARGEST_SIDE, MOST_SAMPLES = 1024, 2**24
# Functions that allocate the parameters of layers.
MAKERS = (torch.empty, torch.zeros, torch.ones, torch.rand, torch.randn, torch.full)


def check_network_sizes(arguments: Any) -> None:
    """Refuse arguments of a network that no file needs, before it is built.

    Raises:
        ValueError: naming the argument, for a whole number above 4096 and for lists of too many layers.
    """
    for name, value in arguments.items() if isinstance(arguments, Mapping) else ():
        several = isinstance(value, list | tuple)
        if several:
            check_count(f"number of {name}", len(value), 0, MOST_LAYERS.get(name, MOST_LAYERS_ELSEWHERE))
        for number in value if several else [value]:
            if isinstance(number, int) and number > LARGEST_SIZE:
                raise ValueError(f"{name} must be at most {LARGEST_SIZE} in a file, got {number}")


def check_drawing(network: nn.Module) -> None:
    """Refuse a network that draws larger pictures, or with more samples, than any file needs, before it draws.

    Raises:
        ValueError: naming the number.
    """
    side, samples = getattr(network, "image_size", 1), getattr(network, "num_samples", 1)
    check_count("image_size in a file", side, 1, LARGEST_SIDE)
    check_count("image_size² · num_samples in a file", side**2 * samples, 1, MOST_SAMPLES)


class LimitedSize(TorchFunctionMode):
    """Refuses tensors before they are allocated, if they would hold more than ``most`` numbers in total."""

    def __init__(self, most: int) -> None:
        super().__init__()
        self.left = most

    def __torch_function__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        if func in MAKERS:
            shape = args[0] if args and isinstance(args[0], list | tuple) else args
            self.left -= math.prod(side for side in shape if isinstance(side, int))
            if self.left < 0:
                raise ValueError("it would be far larger than its file")
        return func(*args, **(kwargs or {}))
