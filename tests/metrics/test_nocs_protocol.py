"""NOCS's evaluation against what the published evaluators gave for the same results."""

from __future__ import annotations

import numpy as np
import pytest

from kfit.geometry import CATEGORIES
from kfit.metrics import evaluate_nocs, scale_agnostic
from kfit.metrics.nocs_matches import match_by_iou, match_by_pose, pose_errors
from kfit.metrics.nocs_objects import Predictions, Truths, predictions_of, truths_of


def wave(*numbers: float) -> float:
    """A number in [0, 1) that looks random and is the same everywhere."""
    return float(np.sin(12.9898 * numbers[0] + 78.233 * numbers[-1] + 37.719 * sum(numbers)) * 43758.5453 % 1)


def rotated(axis: list[float], degrees: float) -> np.ndarray:
    x, y, z = np.array(axis) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = np.deg2rad(degrees)
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def similarity(scale: float, rotation: np.ndarray, translation: list[float] | np.ndarray) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = scale * rotation, translation
    return pose


def made_results(num_images: int = 24) -> list[dict]:
    """Images with up to six objects: found well or badly, twice or not at all, or mistaken for another kind."""
    results = []
    for image in range(num_images):
        truths, sizes, ids, found = [], [], [], []
        for thing in range(image % 7):
            u = [wave(image + 1, thing + 1, k) for k in range(20)]
            ids.append(1 + (image * 5 + thing * thing) % 6)
            rotation = rotated([u[0] - 0.5, u[1] - 0.5, u[2] - 0.5], 360 * u[3])
            truths.append(similarity(0.1 + 0.3 * u[4], rotation, [u[5] - 0.5, 0.6 * u[6] - 0.3, 0.7 + u[7]]))
            size = np.array([0.2 + u[8], 0.2 + u[9], 0.2 + u[10]])
            sizes.append(size / np.linalg.norm(size))
            for again in range(0 if u[11] < 0.1 else 2 if u[11] > 0.85 else 1):
                v = [wave(image + 1, thing + 1, k + 40 * again) - 0.5 for k in range(20, 30)]
                off = 60 * u[12] ** 3
                pose = similarity(
                    (0.1 + 0.3 * u[4]) * np.exp(0.3 * v[0]),
                    rotated([v[1], v[2], v[3]], off) @ rotation,
                    truths[-1][:3, 3] + 0.3 * u[13] ** 2 * np.array([v[4], v[5], v[6]]),
                )
                kind = ids[-1] if u[14] < 0.9 else 1 + ids[-1] % 6
                found.append((kind, pose, sizes[-1] * np.exp(0.2 * np.array(v[7:10])), round(u[15], 1)))
        results.append(
            {
                "gt_class_ids": np.array(ids, np.int64),
                "gt_RTs": np.array(truths).reshape(-1, 4, 4),
                "gt_scales": np.array(sizes, np.float32).reshape(-1, 3),
                "gt_handle_visibility": np.array([float((image + k) % 3 > 0) for k in range(len(ids))]),
                "pred_class_ids": np.array([f[0] for f in found], np.int32),
                "pred_RTs": np.array([f[1] for f in found]).reshape(-1, 4, 4),
                "pred_scales": np.array([f[2] for f in found]).reshape(-1, 3),
                "pred_scores": np.array([f[3] for f in found], np.float32),
                "pred_bboxes": np.ones((len(found), 4), np.int32),
            }
        )
    return results


# Of compute_degree_cm_mAP(…, use_matches_for_pose=True) in utils.py of hughw19/NOCS_CVPR2019@f882eb88, and the same to
# 1e-12 with the clipped arc cosine of compute_mAP in lib/utils.py of mentian/object-deformnet@cd43bb8f, for
# made_results(): bottle, bowl, camera, can, laptop, mug, mean. Names: the overlap, or degrees and centimetres.
GOLDEN = {
    "0.25": [0.75, 0.451515144019, 0.777777762214, 0.737137872218, 0.749999985099, 0.538961035865, 0.667565299903],
    "0.5": [0.75, 0.351515164881, 0.473214273651, 0.417966664463, 0.619444445107, 0.318181812763, 0.488387060144],
    "0.75": [
        0.333333333333,
        0.090000003576,
        0.166666671634,
        0.123076925427,
        0.277248672881,
        0.106060609221,
        0.182731036,
    ],
    "5 2": [0.033333334327, 0.095238099496, 0.0, 0.090909093618, 0.03333333383, 0.092592593282, 0.057567742426],
    "5 5": [0.25, 0.42857144773, 0.0, 0.151515156031, 0.27500000596, 0.203703705221, 0.218131719157],
    "10 5": [0.25, 0.42857144773, 0.084848487377, 0.212121218443, 0.354166667908, 0.203703705221, 0.25556858778],
    "10 10": [0.25, 0.42857144773, 0.145454549789, 0.303030312061, 0.414166682214, 0.472222236296, 0.335574204682],
    "60 100": [1.0, 1.0, 1.0, 1.0, 1.0, 0.864197538959, 0.977366256493],
}


@pytest.fixture(scope="module")
def scores():
    return evaluate_nocs(made_results())


@pytest.mark.parametrize("name", GOLDEN)
def test_precision_is_that_of_the_published_evaluators(scores, name):
    limits = [float(word) for word in name.split()]
    values = scores.iou(limits[0]) if len(limits) == 1 else scores.pose(*limits)
    np.testing.assert_allclose(values, GOLDEN[name], atol=1e-9)


def one(category: str, truths: list, found: list, scores: list[float], observed: list[float] | None = None) -> dict:
    """An image of one category; every box is the same."""
    size = np.full(3, 3**-0.5)
    result = {
        "gt_class_ids": np.full(len(truths), CATEGORIES[category].nocs_id),
        "gt_RTs": np.array(truths).reshape(-1, 4, 4),
        "gt_scales": np.tile(size, (len(truths), 1)),
        "pred_class_ids": np.full(len(found), CATEGORIES[category].nocs_id),
        "pred_RTs": np.array(found).reshape(-1, 4, 4),
        "pred_scales": np.tile(size, (len(found), 1)),
        "pred_scores": np.array(scores),
    }
    return result if observed is None else result | {"gt_handle_visibility": np.array(observed)}


HERE = similarity(0.2, rotated([1, 0.2, 0.1], 25), [0.0, 0.1, 1.0])


def test_a_bottle_turned_about_itself_is_right_and_a_camera_is_not():
    around = HERE @ similarity(1, rotated([0, 1, 0], 90), [0, 0, 0])
    assert evaluate_nocs([one("bottle", [HERE], [around], [1.0])]).pose(1, 1)[0] == 1
    assert evaluate_nocs([one("camera", [HERE], [around], [1.0])], iou="axis_aligned").pose(10, 10)[2] == 0


def test_a_mug_turns_freely_only_where_its_handle_is_known_to_be_hidden():
    around = HERE @ similarity(1, rotated([0, 1, 0], 90), [0, 0, 0])
    hidden, visible, untold = (
        evaluate_nocs([one("mug", [HERE], [around], [1.0], observed)], iou="axis_aligned").pose(5, 5)[5]
        for observed in ([0.0], [1.0], None)
    )
    assert (hidden, visible, untold) == (1, 0, 0)


def test_a_category_without_objects_counts_as_the_published_evaluators_do():
    scores = evaluate_nocs([one("laptop", [HERE], [HERE], [1.0])])
    assert scores.iou(0.25)[:-1].tolist() == [0, 0, 0, 0, 1, 0]
    assert scores.iou(0.25)[-1] == pytest.approx(1 / 6)
    assert scores.mean_of_present(scores.iou(0.25)) == 1
    alone = evaluate_nocs([one("laptop", [HERE], [HERE], [1.0]), one("can", [], [HERE], [1.0])])
    assert np.isnan(alone.iou(0.25)[[3, 6]]).all()
    assert alone.mean_of_present(alone.iou(0.25)) == 1
    assert alone.pose(5, 5)[-1] == pytest.approx(1 / 6)


def test_missed_objects_lower_precision_of_boxes_and_not_of_poses():
    away = similarity(0.2, np.eye(3), [0.5, 0.1, 1.0])
    scores = evaluate_nocs([one("laptop", [HERE, away], [HERE], [0.4])])
    assert scores.iou(0.5)[4] == pytest.approx(0.5)
    assert scores.pose(5, 5)[4] == 1
    assert (scores.num_truths[4], scores.num_found[4]) == (2, 1)


def test_an_object_is_found_once_and_by_the_surest():
    worse = HERE.copy()
    worse[2, 3] += 0.03
    scores = evaluate_nocs([one("laptop", [HERE], [HERE, worse], [0.3, 0.9])])
    assert scores.pose(5, 2)[4] == 0
    assert scores.pose(5, 5)[4] == 1
    assert scores.iou(0.25)[4] == pytest.approx(1)


def test_other_poses_are_evaluated_on_the_detections():
    off = HERE.copy()
    off[:3, 3] *= 3
    result = one("laptop", [HERE], [HERE], [1.0])
    scores = evaluate_nocs([result | {"pred_RTs_ours": off[None]}], poses="pred_RTs_ours")
    assert scores.iou(0.5)[4] == 1
    assert scores.pose(5, 100)[4] == 0
    assert scores.pose(5)[4] == 1
    nothing = evaluate_nocs([result | {"pred_RTs_ours": np.zeros((1, 4, 4))}], poses="pred_RTs_ours")
    assert nothing.pose()[4] == 0


def test_a_half_turn_can_pass_every_threshold_as_published():
    # Rounding leaves the arc cosine's domain; here cos θ is forced below −1 by a matrix that is no rotation.
    pose = np.diag([-1.1, 1, -1.0, 1.0])
    truth, found = (np.array([np.eye(4)]), np.array([pose]))
    errors = pose_errors(
        Predictions(found, np.ones((1, 3)), np.ones(1), np.ones(1, bool)),
        Truths(truth, np.ones((1, 3)), np.zeros(1, bool)),
    )
    assert np.isnan(errors[0, 0, 0])
    assert match_by_pose(np.full((1, 1, 2), np.nan), [0], [0]).all()


def test_overlaps_at_the_threshold_do_not_match_and_do_not_end_the_search():
    matched, taken = match_by_iou(np.array([[0.5, 0.25]], np.float32), [0.5, 0.25, 0.1])
    assert matched[:, 0].tolist() == [False, True, True]
    assert taken.tolist() == [[False, False], [True, False], [True, False]]


def test_free_of_scale_a_model_twice_as_large_and_far_is_right():
    double = HERE.copy()
    double[:3] *= 2
    result = one("laptop", [HERE], [double], [1.0])
    assert evaluate_nocs([result]).pose(5)[4] == 0
    scores = evaluate_nocs([scale_agnostic(result)])
    assert scores.iou(0.99)[4] == 1
    assert scores.pose(1, 1)[4] == 1
    shifted = double.copy()
    shifted[2, 3] += 0.04  # a tenth of the diagonal of 0.4
    again = evaluate_nocs([scale_agnostic(one("laptop", [HERE], [shifted], [1.0]))], shifts=(9, 11))
    assert [again.pose(5, percent)[4] for percent in (9, 11)] == [0, 1]


def test_images_without_anything_change_nothing(scores):
    empty = made_results(1)
    again = evaluate_nocs([*empty, *made_results(), *empty])
    np.testing.assert_array_equal(again.iou_ap, scores.iou_ap)
    np.testing.assert_array_equal(again.pose_ap, scores.pose_ap)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"pred_RTs": None}, "has no pred_RTs; it has gt_RTs"),
        ({"gt_RTs": None}, "has no gt_RTs"),
        ({"pred_scales": np.ones((2, 3))}, r"pred_scales must have shape \(1, 3\) by its class ids, got \(2, 3\)"),
        ({"pred_scores": np.array(["high"])}, "pred_scores must hold numbers"),
        ({"pred_RTs": np.ones((1, 4, 4))}, "last row is 0 0 0 1"),
        ({"gt_class_ids": np.ones((1, 1))}, r"gt_class_ids must be \(N,\) numbers"),
        ({"gt_handle_visibility": np.ones(3)}, "gt_handle_visibility must have shape"),
        ({"image_path": "real/test/7", "pred_RTs": None}, "the result of real/test/7 has no pred_RTs"),
    ],
)
def test_a_result_that_lacks_something_is_named(change, sentence):
    with pytest.raises(ValueError, match=sentence):
        evaluate_nocs([one("mug", [HERE], [HERE], [1.0]) | change])


def test_what_was_not_measured_is_not_reported(scores):
    with pytest.raises(ValueError, match=r"degrees must hold 7\.5 for AP there"):
        scores.pose(7.5, 5)
    with pytest.raises(ValueError, match=r"ious must hold 0\.333"):
        scores.iou(0.333)
    with pytest.raises(ValueError, match="at least one image, got none"):
        evaluate_nocs([])


def test_single_precision_and_lists_are_read_too():
    result = one("mug", [HERE], [HERE], [1.0])
    result |= {"pred_RTs": [HERE.astype(np.float32)], "gt_scales": result["gt_scales"].tolist()}
    assert evaluate_nocs([result]).pose(1, 1)[5] == 1
    assert predictions_of(result, CATEGORIES["mug"]).poses.dtype == np.float32
    assert truths_of(result, CATEGORIES["mug"]).sizes.dtype == np.float64
