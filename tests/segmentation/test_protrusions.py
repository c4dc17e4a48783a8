import cv2
import numpy as np
import pytest

from kfit.segmentation import without_protrusions


def disc(handle: bool = True) -> np.ndarray:
    mask = np.zeros((100, 160), np.float32)
    cv2.circle(mask, (60, 50), 30, 1.0, -1)
    if handle:
        cv2.rectangle(mask, (80, 45), (115, 55), 1.0, -1)
    return mask


def test_a_bar_that_sticks_out_is_left_out() -> None:
    [body] = without_protrusions(disc())
    assert body[:, 94:].sum() == 0
    assert body.sum() == pytest.approx(disc(handle=False).sum(), rel=0.03)


def test_two_bars_are_left_out_one_at_a_time_the_larger_first() -> None:
    mask = disc()
    cv2.rectangle(mask, (55, 5), (65, 30), 1.0, -1)
    first, second = without_protrusions(mask)
    assert first[:, 94:].sum() == 0
    assert first[:18].sum() > 0
    assert second[:18].sum() == 0
    assert second[:, 94:].sum() > 0


def test_neither_discs_nor_boxes_nor_cut_off_objects_have_protrusions() -> None:
    box, cut = np.zeros((100, 160), np.float32), np.zeros((100, 160), np.float32)
    box[20:80, 30:130] = 1
    cut[40:, 60:100] = 1
    for mask in (disc(handle=False), box, cut, np.ones((50, 50), np.float32), np.zeros((9, 9), np.float32)):
        assert without_protrusions(mask) == []
