from __future__ import annotations

import re
from xml.etree import ElementTree

import numpy as np
import torch

from kfit.core import FitResult
from kfit.core.result import History
from kfit.reports.energy_curves import energy_curves

STEPS = 8
SVG = "{http://www.w3.org/2000/svg}"


def fit_of(energy: torch.Tensor, survivors: list[int]) -> FitResult:
    """A fit of one problem whose first survivor won."""
    rows = torch.tensor(survivors)
    least = torch.tensor([energy[:, start][energy[:, start].isfinite()].min() for start in survivors])
    return FitResult({}, least[:1], rows[:1], rows * 0, rows, least, {}, History(energy[:, None], {}, {}))


def pruned() -> FitResult:
    energy = torch.linspace(5, 1, STEPS + 1)[:, None] + torch.arange(4.0)
    energy[4:, 2:] = torch.nan
    energy[6:, 1] = torch.nan  # at rest: it ends early, and still is among the answers
    return fit_of(energy, [0, 1])


def lines(svg: str) -> dict[str, np.ndarray]:
    """The points of each start's line."""
    head = str(svg).replace("<svg ", '<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="x" ', 1)
    found = {}
    for group in ElementTree.fromstring(head).iter(f"{SVG}g"):
        if str(group.get("id")).startswith("start-"):
            drawn = " ".join(str(path.get("d")) for path in group.iter(f"{SVG}path"))
            points = np.array([float(part) for part in re.findall(r"-?\d+(?:\.\d+)?", drawn)]).reshape(-1, 2)
            found[str(group.get("id"))] = np.unique(points.round(3), axis=0)
    return found


def test_every_start_has_a_line_and_those_given_up_end_where_they_were() -> None:
    svg, width = energy_curves(pruned(), STEPS)
    found = lines(svg)
    assert sorted(found) == ["start-0", "start-1", "start-2", "start-3"]
    steps = {name: np.ptp(points[:, 0]) / width for name, points in found.items()}
    assert np.allclose([steps[name] for name in sorted(steps)], [STEPS, 5, 3, 3], atol=0.02)


def test_given_up_starts_fade_and_the_winner_stands_out() -> None:
    svg, _ = energy_curves(pruned(), STEPS)
    faded = re.findall(r"stroke-opacity: ([\d.]+)", svg.split('id="start-2"')[1].split("</g>")[0])
    assert faded == sorted(faded, reverse=True)
    assert float(faded[0]) > 2 * float(faded[-1])
    won = svg.split('id="start-0"')[1].split("</g>")[0]
    assert "var(--accent)" in won
    assert "stroke-opacity" not in won
    assert "var(--accent)" not in svg.split('id="start-1"')[1].split("</g>")[0]
    assert "given up" in svg


def test_a_start_that_was_given_up_at_once_has_a_mark() -> None:
    energy = torch.tensor([[2.0, 3.0], [1.0, torch.nan]])
    svg, _ = energy_curves(fit_of(energy, [0]), 1)
    assert sorted(lines(svg)) == ["start-0", "start-1"]
    assert "1 were given up" in svg


def test_the_plot_has_the_pages_colours_and_differs_from_another() -> None:
    svg, _ = energy_curves(pruned(), STEPS)
    assert not re.search(r"#0[0-9a]0[0-9a]0[0-9a]\b", svg)
    assert not re.search(r'id="\w+_\d+"', svg)
    assert svg.count('id="now"') == 1
    assert svg == energy_curves(pruned(), STEPS)[0]
