import numpy as np
import pytest

from kfit.metrics import average_precision, nocs_symmetry


def test_all_found_is_one_and_none_found_is_zero():
    assert average_precision(np.ones(4, bool), 4) == 1
    assert average_precision(np.zeros(4, bool), 4) == 0


def test_precision_is_the_best_at_the_same_or_a_larger_recall():
    # hit, miss, hit, hit of five objects: recalls 1/5, 2/5, 3/5 at precisions 1, 3/4 (of 2/3 and 3/4), 3/4
    assert average_precision(np.array([1, 0, 1, 1], bool), 5) == pytest.approx((1 + 0.75 + 0.75) / 5)


def test_it_is_the_area_that_scikit_learn_and_coco_call_so_without_their_sampling():
    rng = np.random.default_rng(0)
    matched = rng.uniform(size=50) < 0.6
    precision = matched.cumsum() / np.arange(1, 51)
    expected = sum(precision[k:].max() for k in np.flatnonzero(matched)) / 40
    assert average_precision(matched, 40) == pytest.approx(expected)


def test_rows_are_measured_at_once():
    matched = np.array([[[1, 1], [1, 0]], [[0, 1], [0, 0]]], bool)
    np.testing.assert_allclose(average_precision(matched, 2), [[1, 0.5], [0.25, 0]])


def test_without_objects_it_is_as_published():
    assert average_precision(np.zeros(0, bool), 0) == 0
    assert average_precision(np.zeros(0, bool), 3) == 0
    assert np.isnan(average_precision(np.zeros(2, bool), 0))


def test_hidden_handles_make_a_mug_symmetric_and_nothing_else():
    assert nocs_symmetry("mug", handle_visible=False) == "y"
    assert nocs_symmetry("mug") == "none"
    assert nocs_symmetry("bowl") == "y"
    assert nocs_symmetry("laptop", handle_visible=False) == "none"
