"""What Python hands to `pose` that is no photo, mask, box, camera or depth is refused by name, before a fit."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch

from kfit.fitting.pipeline import FitPipeline
from kfit.geometry import CATEGORIES
from kfit.pose.category_model import CategoryModel
from kfit.pose.observed_object import ObservedObject

INF, NAN = float("inf"), float("nan")
PIXELS = np.random.default_rng(0).integers(0, 256, (48, 64, 3), np.uint8)
MASK = np.zeros((48, 64), np.uint8)
MASK[8:30, 20:50] = 255
CAMERA = np.array([[60.0, 0, 32], [0, 60, 24], [0, 0, 1]])
GOOD = (MASK > 0).astype(np.float32)
# What is given instead of a good photo with its mask and camera, and a word of what is said of it.
WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "NaN pixels": ({"image": np.full((48, 64, 3), NAN, np.float32)}, "image"),
    "0 to 255 as floats": ({"image": PIXELS.astype(np.float32)}, "image must lie in"),
    "negative": ({"image": -GOOD[..., None].repeat(3, 2)}, "image must lie in"),
    "channels first": ({"image": PIXELS.transpose(2, 0, 1)}, "image must have shape"),
    "a batch": ({"image": PIXELS[None]}, "image must have shape"),
    "grey": ({"image": PIXELS[..., 0]}, "image must have shape"),
    "alpha": ({"image": PIXELS[..., [0, 1, 2, 0]]}, "image must have shape"),
    "no pixels": ({"image": PIXELS[:0]}, "image must have shape"),
    "whole numbers": ({"image": PIXELS.astype(np.int64)}, "image must be uint8"),
    "words": ({"image": np.full((48, 64, 3), "x")}, "image must be an array of numbers"),
    "objects": ({"image": np.full((48, 64, 3), None)}, "image must be an array"),
    "complex": ({"image": PIXELS.astype(complex)}, "image must be an array"),
    "a list of lists": ({"image": PIXELS.tolist()}, "image must be uint8"),
    "ragged": ({"image": [[1], [1, 2]]}, "image"),
    "nothing": ({"image": None}, "image must be an array"),
    "a tensor of NaN": ({"image": torch.full((48, 64, 3), NAN)}, "image must lie in"),
    "an empty mask": ({"mask": GOOD * 0}, "mask is empty"),
    "a mask of NaN": ({"mask": GOOD * NAN}, "mask is empty"),
    "a mask of another size": ({"mask": GOOD[1:]}, "mask must have"),
    "a mask with channels": ({"mask": GOOD[..., None]}, "mask must have"),
    "a mask of words": ({"mask": np.full((48, 64), "x")}, "mask"),
    "a ragged mask": ({"mask": [[1], [1, 2]]}, "mask"),
    "a mask and a box": ({"box": (1, 1, 9, 9)}, "mask and box"),
    **{
        f"a box {box}": ({"mask": None, "box": box}, "box")
        for box in [
            (NAN, 1, 9, 9), (1, 1, INF, 9), (1, 1, 0, 9), (9, 9, -5, -5), (900, 900, 9, 9), (-90, -90, 9, 9),
            (1e30, 1e30, 9, 9), (1, 1, 1e-9, 1e-9), (1, 2, 3), (1, 2, 3, 4, 5), ("a", 1, 1, 1), (None,) * 4, "abcd", 3,
        ]
    },
    **{
        f"a camera {name}": ({"intrinsics": camera}, "intrinsics")
        for name, camera in {
            "of zeros": CAMERA * 0, "negative": -CAMERA, "of NaN": CAMERA * NAN, "of infinities": CAMERA + INF,
            "huge": CAMERA * 1e9, "tiny": CAMERA * 1e-3, "of 2 x 2": CAMERA[:2, :2], "a number": 5.0, "words": "x",
            "ragged": [[1], [1, 2]], "complex": CAMERA * 1j, "without its last row": CAMERA * [[1], [1], [0]],
            "with a skew of infinity": CAMERA + np.array([[0, INF, 0], [0, 0, 0], [0, 0, 0]]),
        }.items()
    },
    **{
        f"a depth {name}": ({"depth": depth, "intrinsics": CAMERA}, "depth")
        for name, depth in {
            "of NaN": GOOD * NAN, "of infinities": GOOD + INF, "of zeros": GOOD * 0, "negative": -GOOD,
            "of another size": GOOD[:5], "with channels": GOOD[..., None], "words": np.full((48, 64), "x"),
            "ragged": [[1], [1, 2]], "unknown on the object": 1 - GOOD, "a number": 1.0,
        }.items()
    },
    "a file that is not there": ({"image": "gone.png"}, "there is no file gone.png"),
    "a name with a zero": ({"image": "a\0b.png"}, "there is no file"),
    "a segmenter that is none": ({"mask": None, "segmenter": 5}, "segmenter"),
}  # fmt: skip


@pytest.mark.parametrize("wrong", WRONG)
def test_wrong_arguments_are_refused_before_a_fit(
    wrong: str, mug: CategoryModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    inputs, message = WRONG[wrong]

    def fit(*_: Any, **__: Any) -> None:
        raise AssertionError("the fit was begun")

    monkeypatch.setattr(FitPipeline, "forward", fit)
    with pytest.raises((ValueError, TypeError, FileNotFoundError)) as error:
        mug.pose(**{"image": PIXELS, "mask": GOOD, **inputs})
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_tensors_and_lists_do_as_well_as_arrays() -> None:
    photo, mask, camera = PIXELS.astype(np.float32) / 255, GOOD.tolist(), torch.from_numpy(CAMERA)
    observed = ObservedObject.of(torch.from_numpy(photo).requires_grad_(), CATEGORIES["mug"], 32, mask, None, camera)  # type: ignore[arg-type]
    plain = ObservedObject.of(photo, CATEGORIES["mug"], 32, GOOD, None, CAMERA)
    assert torch.equal(observed.observation.field("image"), plain.observation.field("image"))
    assert torch.equal(observed.intrinsics, plain.intrinsics)


def test_colours_that_rounding_took_out_of_range_are_taken() -> None:
    photo = PIXELS.astype(np.float64) / 255
    photo[5, 5], photo[6, 6] = 1 + 1e-7, -1e-7
    observed = ObservedObject.of(photo, CATEGORIES["mug"], 32, GOOD, None, CAMERA)
    assert observed.image.min() == 0
    assert observed.image.max() == 1
