import numpy as np
import pytest
import torch

from kfit.core import Observation, Rendering
from kfit.geometry import CATEGORIES
from kfit.pose.object_depth import object_depth, wrong_depth, wrong_size

CAMERA = torch.tensor([[600.0, 0, 320], [0, 600, 240], [0, 0, 1]], dtype=torch.float64)
MUG = CATEGORIES["mug"]
MASK = np.zeros((480, 640), np.float32)
MASK[200:320, 260:380] = 1  # 12 cm by 12 cm at 60 cm
DEPTH = np.full(MASK.shape, 1.2, np.float32)
DEPTH[MASK > 0] = 0.6 + 0.04 * np.random.default_rng(0).random(120 * 120)


def test_depth_of_the_object_stays_as_it_is() -> None:
    found, notes, warnings = object_depth(DEPTH, MASK, CAMERA, MUG)
    np.testing.assert_array_equal(found, DEPTH)
    assert notes == warnings == []


@pytest.mark.parametrize(
    ("times", "unit"),
    [
        (1000, "millimetres read as metres"),
        (100, "centimetres read as metres"),
        (1 / 0.0254, "inches read as metres"),
        (10, "0.1 mm read as millimetres"),
        (0.001, "metres divided by 1000"),
    ],
)
def test_a_depth_in_another_unit_is_refused_and_the_unit_named(times: float, unit: str) -> None:
    with pytest.raises(ValueError, match=rf"depth makes the mug .* m large, .*between 0.07 and 0.35 m.*{unit}"):
        object_depth(DEPTH * np.float32(times), MASK, CAMERA, MUG)


@pytest.mark.parametrize(("times", "unit"), [(4, "0.25 mm"), (5, "1/5000 m"), (3.28, "feet"), (0.256, "1/256 m")])
def test_a_found_size_out_of_range_names_the_unit(times: float, unit: str) -> None:
    warning = wrong_size(MUG, 0.17 * times)
    assert warning is not None
    assert unit in warning
    assert "50 % at most" in warning


@pytest.mark.parametrize("category", CATEGORIES.values(), ids=lambda category: category.name)
def test_the_mean_size_is_in_range_and_four_times_it_is_not(category) -> None:
    assert wrong_size(category, category.mean_diagonal) is None
    assert wrong_size(category, 4 * category.mean_diagonal) is not None


def test_outliers_are_unknown_and_reported() -> None:
    depth = DEPTH.copy()
    rng = np.random.default_rng(1)
    wild = (rng.random(depth.shape) < 0.2) & (MASK > 0)
    depth[wild] = rng.uniform(0.01, 10, wild.sum())
    found, notes, warnings = object_depth(depth, MASK, CAMERA, MUG)
    kept = found.isfinite().numpy() & (MASK > 0)
    assert np.abs(found.numpy() - DEPTH)[kept].max() < 0.3
    assert np.isnan(found.numpy()[wild]).mean() > 0.9
    np.testing.assert_array_equal(found.numpy()[~wild], DEPTH[~wild])
    assert "of the depths on the object lie more than" in notes[0]
    assert warnings == []


@pytest.mark.parametrize("half", ["left", "more than half"])
def test_half_of_the_mask_on_the_background_is_doubted(half: str) -> None:
    depth = DEPTH.copy()
    depth[:, : 320 if half == "left" else 325] = 1.0
    found, notes, warnings = object_depth(depth, MASK, CAMERA, MUG)
    known = found.numpy()[(MASK > 0) & found.isfinite().numpy()]
    assert known.max() < 0.65
    assert notes == []
    assert "does the mask cover the background?" in warnings[0]


def test_a_depth_that_is_known_nowhere_on_the_object_is_refused() -> None:
    with pytest.raises(ValueError, match="unknown everywhere on the object"):
        object_depth(DEPTH * (MASK == 0), MASK, CAMERA, MUG)


@pytest.mark.parametrize(("share", "warned"), [(0.2, False), (0.3, True)])
def test_a_drawing_whose_depth_differs_on_much_of_the_object_is_reported(share: float, warned: bool) -> None:
    mask = torch.zeros(1, 1, 20, 20)
    mask[..., 5:15, :] = 1
    measured = torch.where(mask > 0, 0.62, 3.0)
    measured[..., :10] += 0.05
    measured[..., 6, :] = torch.nan
    drawn = torch.where(torch.arange(20) < 10, 0.35, 0.1).expand(1, 1, 20, 20).clone()  # 0.6 m away, diagonal 0.2 m
    drawn[..., : round(20 * share)] += 0.6
    rendering = Rendering(torch.ones(1, 3, 20, 20), torch.ones_like(mask), drawn)
    warning = wrong_depth(rendering, Observation(torch.ones(1, 3, 20, 20), mask, depth=measured), 0.6, 0.2)
    assert (warning is not None) == warned
    if warned:
        assert warning == ("drawn and measured depth agree on 70 % of the object only: distance and size may be off")
