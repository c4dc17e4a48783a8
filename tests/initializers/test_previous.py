from __future__ import annotations

import pytest
import torch

from kfit.core import Angle, FitResult, History, Observation, Positive, Variable
from kfit.initializers import Previous

VARIABLES = {"code": Variable((3,)), "azimuth": Variable((), Angle()), "scale": Variable((), Positive())}
NOTHING = torch.zeros(0)


def answer(**values: torch.Tensor) -> FitResult:
    plain = {"code": torch.ones(2, 3), "azimuth": torch.tensor([1.0, -2.0]), "scale": torch.tensor([0.5, 2.0])}
    history = History(NOTHING, {}, {})
    return FitResult(plain | values, NOTHING, NOTHING, NOTHING, NOTHING, NOTHING, {}, history)


def starts(initializer: Previous, num_starts: int = 4, problems: int = 2) -> dict[str, torch.Tensor]:
    rngs = [torch.Generator().manual_seed(number) for number in range(problems)]
    return initializer(VARIABLES, Observation(torch.ones(problems, 3, 4, 4)), num_starts, rngs)


def test_without_spread_every_start_is_the_answer() -> None:
    values = starts(Previous(answer()))
    torch.testing.assert_close(values["azimuth"], torch.tensor([1.0, -2.0]).repeat_interleave(4))
    torch.testing.assert_close(values["scale"], torch.tensor([0.5, 2.0]).repeat_interleave(4))
    torch.testing.assert_close(values["code"], torch.ones(8, 3))


def test_the_first_start_is_the_answer_and_the_others_spread_around_it() -> None:
    values = starts(Previous(answer(), sigma={"azimuth": 0.1, "scale": 0.2}), 4000)
    azimuth, scale = values["azimuth"].view(2, 4000), values["scale"].view(2, 4000)
    assert azimuth[:, 0].tolist() == pytest.approx([1.0, -2.0])
    assert (azimuth / torch.pi).std(1).tolist() == pytest.approx([0.1, 0.1], rel=0.05)
    assert scale.log().std(1).tolist() == pytest.approx([0.2, 0.2], rel=0.05)
    assert bool((scale > 0).all())
    torch.testing.assert_close(values["code"], torch.ones(8000, 3))


def test_takes_over_only_the_named_variables() -> None:
    initializer = Previous(answer(), on=("azimuth",))
    assert initializer.on == ("azimuth",)
    assert set(starts(initializer)) == {"azimuth"}


def test_refuses_what_it_cannot_start_from() -> None:
    with pytest.raises(ValueError, match=r"Previous: on must be one of .*code.* got .tilt"):
        Previous(answer(), on=("tilt",))
    with pytest.raises(ValueError, match="Previous: sigma: unknown code; the names are azimuth"):
        Previous(answer(), on=("azimuth",), sigma={"code": 0.1})
    with pytest.raises(ValueError, match="Previous: sigma of code must be finite and at least 0"):
        Previous(answer(), sigma={"code": -0.1})
    with pytest.raises(ValueError, match="Previous: azimuth of a problem is not finite"):
        Previous(answer(azimuth=torch.tensor([1.0, torch.nan])))
    with pytest.raises(ValueError, match="the result holds 2 problems, the observation 3"):
        starts(Previous(answer()), problems=3)
