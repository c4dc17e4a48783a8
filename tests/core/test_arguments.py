"""One call checks all scalar arguments of a class or function by the types in its signature."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
import torch
from torch import Tensor

from kfit.core.arguments import check_arguments
from kfit.core.check import check_list, check_positive, check_rising


def draw(
    picture: Tensor,
    width: int = 4,
    seed: int = 0,
    blur: float = 0.5,
    rate: float = 1.0,
    mirror: bool = False,
    motion: Literal["affine", "tps"] = "affine",
    path: str | Path | None = None,
    channels: Sequence[int] = (4, 8),
    box: tuple[float, float] = (0.0, 1.0),
    span: tuple[float, float] = (0.0, 1.0),
    rates: float | dict[str, float] = 0.1,
    std: Sequence[float] = (1.0, 2.0),
    history: bool | int = True,
) -> None:
    check_arguments(
        draw,
        locals(),
        seed=(0,),
        blur=(0, 8),
        rate=(check_positive,),
        channels=(2, 64),
        span=(check_rising, -1, 1),
        rates=(0,),
        std=(check_list, 2, check_positive),
    )


@dataclass(frozen=True)
class Side:
    length: float
    count: int | None = None

    def __post_init__(self) -> None:
        check_arguments(Side, vars(self), length=(0, 10))


@pytest.mark.parametrize(
    "values",
    [
        {},
        {"width": 1, "seed": 0, "blur": 8, "rate": 1e-9, "mirror": True, "motion": "tps"},
        {"path": "here"},
        {"path": Path("here"), "channels": [2, 64], "box": [1, 2], "span": [0.5, 0.5]},
        {"rates": {"x": 0.0}},
        {"std": [1, 2]},
        {"history": False},
        {"history": 3},
    ],
)
def test_values_of_the_types_and_within_the_bounds_are_accepted(values):
    draw(torch.zeros(3), **values)


@pytest.mark.parametrize(
    ("values", "kind", "message"),
    [
        ({"width": 0}, ValueError, "draw: width must be at least 1, got 0"),
        ({"width": 2.0}, TypeError, "draw: width must be a whole number, got 2.0"),
        ({"width": True}, TypeError, "draw: width must be a whole number, got True"),
        ({"width": None}, TypeError, "draw: width must be a whole number, got None"),
        ({"seed": -1}, ValueError, "draw: seed must be at least 0, got -1"),
        ({"blur": math.nan}, ValueError, "draw: blur must lie between 0 and 8, got nan"),
        ({"blur": "x"}, TypeError, "draw: blur must be a number, got 'x'"),
        ({"rate": 0}, ValueError, "draw: rate must be above 0 and finite, got 0"),
        ({"mirror": 1}, TypeError, "draw: mirror must be False or True, got 1"),
        ({"motion": "flow"}, ValueError, "draw: motion must be 'affine' or 'tps', got 'flow'"),
        ({"path": 3}, TypeError, "draw: path must be text, got 3"),
        ({"channels": 8}, TypeError, "draw: channels must be a list, got 8"),
        ({"channels": []}, ValueError, r"draw: channels must hold at least one item, got \[\]"),
        ({"channels": [4, 1]}, ValueError, "draw: channels must lie between 2 and 64, got 1"),
        ({"box": (1.0,)}, ValueError, r"draw: box must hold 2 items, got \(1.0,\)"),
        ({"box": (1.0, math.inf)}, ValueError, "draw: box must be finite, got inf"),
        ({"span": (1, 0)}, ValueError, r"draw: span must rise within -1 to 1, got \(1, 0\)"),
        ({"rates": -1.0}, ValueError, "draw: rates must be finite and at least 0, got -1.0"),
        ({"rates": {"x": -1.0}}, ValueError, "draw: rates of x must be finite and at least 0, got -1.0"),
        ({"rates": {"a\nb": -1.0}}, ValueError, r"draw: rates of 'a\\nb' must be finite and at least 0, got -1.0"),
        ({"rate": np.float32("inf")}, ValueError, "draw: rate must be above 0 and finite, got .*inf.*"),
        ({"rate": 10**400}, ValueError, "draw: rate must be above 0 and finite, got 1000.*000"),
        ({"rates": {1: 0.1}}, TypeError, "draw: rates: its keys must be of type str, got 1"),
        ({"rates": [0.1]}, TypeError, r"draw: rates must be a number, got \[0.1\]"),
        ({"history": 0}, ValueError, "draw: history must be at least 1, got 0"),
        ({"history": "x"}, TypeError, "draw: history must be a whole number, got 'x'"),
        ({"std": [1.0, 0.0]}, ValueError, "draw: std must be above 0 and finite, got 0.0"),
    ],
)
def test_others_are_refused_by_the_name_of_the_argument(values, kind, message):
    with pytest.raises(kind, match=f"^{message}$"):
        draw(torch.zeros(3), **values)


def test_what_is_no_scalar_is_not_checked():
    draw("no tensor")


def test_fields_of_a_dataclass_are_checked_too():
    assert Side(1.0).count is None
    with pytest.raises(ValueError, match=r"^Side: length must lie between 0 and 10, got 11$"):
        Side(11)
    with pytest.raises(ValueError, match=r"^Side: count must be at least 1, got 0$"):
        Side(1.0, 0)
