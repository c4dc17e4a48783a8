"""Readers of Wild6D, HouseCat6D, Objectron and BOP, on lookalikes with one mug of known pose."""

import pickle

import numpy as np
import pytest
from lookalikes import DIAGONAL, K, mug, save, write_bop, write_housecat6d, write_objectron, write_wild6d

from kfit.data.bop import BOPEstimate, BOPFrames, read_bop_results, write_bop_results
from kfit.data.housecat6d import HouseCat6DFrames
from kfit.data.nocs_results import NOCSPrediction
from kfit.data.objectron import ObjectronFrames
from kfit.data.wild6d import Wild6DFrames

WRITERS = {"wild6d": write_wild6d, "housecat6d": write_housecat6d, "objectron": write_objectron, "bop": write_bop}


VICTIMS = {
    "wild6d": "pkl_annotations/mug/mug-0001-1.pkl",
    "housecat6d": "test_scene1/labels/000000_label.pkl",
    "objectron": "annotation.pbdata",
    "bop": "test/000001/scene_gt.json",
}


def frames_of(kind, root):
    if kind == "wild6d":
        return Wild6DFrames(str(root), "mug")
    if kind == "housecat6d":
        return HouseCat6DFrames(str(root))
    if kind == "objectron":
        return ObjectronFrames(str(root / "annotation.pbdata"), str(root / "images"))
    return BOPFrames(str(root), {14: "mug"})


def read_first(kind, root):
    return frames_of(kind, root)[0]


@pytest.mark.parametrize("kind", WRITERS)
def test_a_reader_gives_the_pose_size_and_camera_that_were_drawn(kind, tmp_path):
    WRITERS[kind](tmp_path / "set")
    frames = frames_of(kind, tmp_path / "set")
    assert len(frames) == 1
    frame = frames[0]
    view, rotation, translation, size = mug()
    (thing,) = frame.objects
    assert thing.category == "mug"
    np.testing.assert_allclose(thing.pose[:3, :3] / DIAGONAL, rotation, atol=1e-6)
    np.testing.assert_allclose(thing.pose[:3, 3], translation, atol=1e-6)
    np.testing.assert_allclose(thing.size * DIAGONAL, size, atol=1e-6)
    np.testing.assert_allclose(frame.intrinsics, K, atol=1e-5)
    rows, columns = np.nonzero(view.mask > 0.5)
    top, left, bottom, right = thing.box
    assert top <= rows.min() <= rows.max() < bottom
    assert left <= columns.min() <= columns.max() < right
    assert frame.image.is_file()
    assert (thing.mask is None) == (kind == "objectron")


def test_an_answer_is_written_in_the_model_s_own_frame_of_bop(tmp_path):
    write_bop(tmp_path / "set")
    frames = frames_of("bop", tmp_path / "set")
    frame = frames[0]
    _, rotation, translation, size = mug()
    box = tuple(int(side) for side in frame.objects[0].box)
    frames.write(tmp_path / "out.csv", frame, [NOCSPrediction("mug", rotation, translation, size, 0.7, box)])
    (one,) = read_bop_results(tmp_path / "out.csv")
    truth = frames.truths[1, 3][0]
    assert (one.scene_id, one.im_id, one.obj_id, one.score) == (1, 3, 14, 0.7)
    np.testing.assert_allclose(one.rotation.ravel(), truth["cam_R_m2c"], atol=1e-6)
    np.testing.assert_allclose(1000 * one.translation, truth["cam_t_m2c"], atol=1e-4)


def test_results_of_bop_read_back(tmp_path):
    one = BOPEstimate(2, 3, 4, 0.5, np.eye(3), np.array([0.1, -0.2, 1.0]), 0.25)
    write_bop_results(tmp_path / "r.csv", [one])
    (back,) = read_bop_results(tmp_path / "r.csv")
    assert (back.scene_id, back.im_id, back.obj_id, back.score, back.time) == (2, 3, 4, 0.5, 0.25)
    np.testing.assert_allclose(back.translation, one.translation)
    (tmp_path / "r.csv").write_text("scene_id,im_id,obj_id,score,R,t,time\n1,2,3,0.5,1 0 0 0 1 0,0 0 1,-1\n")
    with pytest.raises(ValueError, match="line 2 is no result of BOP"):
        read_bop_results(tmp_path / "r.csv")


@pytest.mark.parametrize("kind", WRITERS)
def test_a_file_that_is_damaged_gets_a_sentence_that_names_it(kind, tmp_path):
    root = tmp_path / "set"
    WRITERS[kind](root)
    victim = root / VICTIMS[kind]
    victim.write_bytes(victim.read_bytes()[:-7])
    with pytest.raises(ValueError, match=victim.name.replace(".", r"\.")):
        read_first(kind, root)


def test_folders_without_frames_say_what_is_missing(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"holds no annotations: no \*\.pkl"):
        Wild6DFrames(str(tmp_path), "mug")
    with pytest.raises(FileNotFoundError, match="holds no frames"):
        HouseCat6DFrames(str(tmp_path))
    with pytest.raises(FileNotFoundError, match="there is no annotation"):
        ObjectronFrames(str(tmp_path / "a.pbdata"), str(tmp_path))
    with pytest.raises(FileNotFoundError, match="holds no scenes of BOP"):
        BOPFrames(str(tmp_path), {1: "mug"})


def test_pictures_of_objectron_in_another_size_are_refused(tmp_path):
    write_objectron(tmp_path)
    for size, size_text in (((48, 64), "has 64 x 48 pixels"), ((128, 96), "has 96 x 128 pixels")):
        save(tmp_path / "images" / "0.jpg", np.zeros((*size, 3), np.uint8))
        with pytest.raises(ValueError, match=f"0.jpg {size_text}, but the annotated camera 128 x 96; extract upright"):
            read_first("objectron", tmp_path)
    (tmp_path / "images" / "0.jpg").write_bytes(b"none")
    with pytest.raises(ValueError, match=r"0\.jpg is no picture"):
        read_first("objectron", tmp_path)


@pytest.mark.parametrize(
    "annotation",
    [{"rotation": np.eye(3)}, {"rotation": np.zeros((3, 3)), "translation": np.ones(3), "size": np.ones(3)}],
    ids=["nothing but a rotation", "no rotation"],
)
def test_annotations_of_wild6d_without_a_pose_name_file_and_frame(annotation, tmp_path):
    write_wild6d(tmp_path)
    (tmp_path / VICTIMS["wild6d"]).write_bytes(pickle.dumps({"annotations": [annotation]}))
    with pytest.raises(ValueError, match=r"mug-0001-1\.pkl has no pose of frame 0"):
        read_first("wild6d", tmp_path)


def test_a_video_of_wild6d_without_masks_says_what_is_missing(tmp_path):
    write_wild6d(tmp_path)
    next(tmp_path.rglob("0-mask.png")).unlink()
    with pytest.raises(FileNotFoundError, match=r"holds no annotated frames: no N\.jpg with N-mask\.png"):
        read_first("wild6d", tmp_path)


def test_intrinsics_of_housecat6d_that_are_none_name_their_file(tmp_path):
    write_housecat6d(tmp_path)
    file = tmp_path / "test_scene1" / "intrinsics.txt"
    file.write_text("a b c")
    with pytest.raises(ValueError, match=r"intrinsics\.txt holds no intrinsics"):
        read_first("housecat6d", tmp_path)
    file.unlink()
    with pytest.raises(FileNotFoundError, match=r"there is no file .*intrinsics\.txt"):
        read_first("housecat6d", tmp_path)
