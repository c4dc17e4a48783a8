"""Names that weights had in files of earlier versions."""

from __future__ import annotations

from functools import partial
from typing import Any

from torch import nn

# Old name of a network's part → the new one.
RENAMED = {"look": "features", "say": "output"}


def read_old_weights(network: nn.Module) -> None:
    """Have a network's `load_state_dict` understand the old names of its own parts, in checkpoints too.

    >>> class Head(nn.Module):
    ...     def __init__(self):
    ...         super().__init__()
    ...         self.output = nn.Linear(2, 1)
    ...         read_old_weights(self)
    >>> head = Head()
    >>> head.load_state_dict({"say.weight": head.output.weight, "say.bias": head.output.bias})
    <All keys matched successfully>
    """
    parts = {old: new for old, new in RENAMED.items() if hasattr(network, new)}
    network.register_load_state_dict_pre_hook(partial(_rename, parts))


def _rename(parts: dict[str, str], module: nn.Module, state: dict[str, Any], prefix: str, *_: Any) -> None:
    for key in [key for key in state if key.startswith(prefix)]:
        name, dot, rest = key.removeprefix(prefix).partition(".")
        if name in parts:
            state[f"{prefix}{parts[name]}{dot}{rest}"] = state.pop(key)
