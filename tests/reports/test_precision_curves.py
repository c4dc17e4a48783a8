import numpy as np
import pytest

from kfit.metrics import evaluate_nocs
from kfit.reports.precision_curves import curves_by_category, curves_by_method


@pytest.fixture(scope="module")
def scores():
    found = np.diag([0.2, 0.2, 0.2, 1.0])
    found[2, 3] = 0.03
    size = np.array([[0.6, 0.64, 0.48]])
    truth = {"gt_class_ids": np.array([5]), "gt_RTs": np.diag([0.2, 0.2, 0.2, 1.0])[None], "gt_scales": size}
    result = truth | {"pred_class_ids": np.array([5]), "pred_RTs": found[None], "pred_scales": size}
    return evaluate_nocs([result | {"pred_scores": np.ones(1)}], iou="oriented")


def test_a_row_a_method_has_a_curve_a_category_and_the_mean(scores):
    figure = curves_by_category({"ours": scores, "theirs": scores}, "translation error [cm]")
    assert len(figure.axes) == 6
    labels = [axes.get_xlabel() for axes in figure.axes]
    assert labels == ["3D IoU [%]", "rotation error [°]", "translation error [cm]"] * 2
    curves = {line.get_label(): line.get_ydata() for line in figure.axes[2].get_lines()}
    assert list(curves) == ["bottle", "bowl", "camera", "can", "laptop", "mug", "mean"]
    np.testing.assert_array_equal(curves["laptop"], [0] * 6 + [100] * 25)


def test_a_plot_a_category_has_a_curve_a_method(scores):
    figure = curves_by_method({"ours": scores, "theirs": scores}, "rotation")
    assert [axes.get_title() for axes in figure.axes][:7] == [
        "bottle",
        "bowl",
        "camera",
        "can",
        "laptop",
        "mug",
        "mean",
    ]
    assert [line.get_label() for line in figure.axes[4].get_lines()] == ["ours", "theirs"]
    with pytest.raises(ValueError, match="part must be one of iou, rotation, translation, got 'scale'"):
        curves_by_method({"ours": scores}, "scale")
