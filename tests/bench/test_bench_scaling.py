"""`kfit bench scaling`."""

from __future__ import annotations

import pytest
import torch

from kfit.bench.fit_scaling import DEFAULTS, cost_of, resized
from kfit.bench.scaling import figure, sections
from kfit.cli.main import main
from kfit.models import load

POINTS: dict[str, list[tuple[int, float, float | None]]] = {
    "objects": [(1, 0.5, 100.0), (2, 1.0, 110.0)],
    "steps": [(4, 0.2, None)],
}


def test_sizes_are_compared_with_the_first() -> None:
    grown, processes = sections(POINTS, {1: 0.8, 2: 1.5}, {"objects": 2})
    assert grown.rows[1] == ["objects", "2", "1.00", "2.0 ×", "110"]
    assert grown.rows[2] == ["steps", "4", "0.20", "1.0 ×", "unknown"]
    assert processes.rows[1] == ["2", "1.50", "1.88 ×"]


def test_a_plot_for_each_size() -> None:
    labels = [plot.get_xlabel() for plot in figure(POINTS).axes]
    assert {"objects", "steps"} <= set(labels)


def test_a_longer_code_draws_the_same_pictures() -> None:
    model = load("can")
    code, angle = torch.randn(2, 16), torch.tensor([0.3, 0.5])
    with torch.no_grad():
        own = model.generator(code=code, azimuth=angle, elevation=angle)
        longer = torch.nn.functional.pad(code, (0, 4))
        other = resized(model, 20, 64)(code=longer, azimuth=angle, elevation=angle)
    torch.testing.assert_close(other.image, own.image, rtol=0, atol=1e-5)


def test_pictures_are_those_of_starts_and_steps() -> None:
    cost = cost_of(load("can"), {**DEFAULTS, "objects": 2, "starts": 2, "steps": 1, "picture size": 32})
    assert cost.pictures == 2 * 2 * 2


@pytest.mark.slow
def test_memory_does_not_grow_with_the_number_of_objects() -> None:
    model = load("can")
    few, many = (cost_of(model, {**DEFAULTS, "objects": count, "steps": 1}) for count in (4, 16))
    if few.megabytes is not None and many.megabytes is not None:
        # Sixteen pictures are drawn at once, whatever their number; what is kept of each row is small.
        assert many.megabytes - few.megabytes < 100


def test_a_users_mistake_gets_one_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["bench", "scaling", "--fits", "0"])
    assert "--fits must be at least 1" in capsys.readouterr().err
