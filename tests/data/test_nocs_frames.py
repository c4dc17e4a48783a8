"""Frames of CAMERA25 and REAL275: look-alikes written here, and the real excerpt where it is at hand."""

from __future__ import annotations

import pickle
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from kfit.data import NOCSFrames, read_frame
from kfit.data.mesh_files import load_mesh
from kfit.data.nocs_frame import CAMERA_INTRINSICS, REAL_INTRINSICS, read_depth
from kfit.geometry import rotation_error

SHAPE = (64, 112)
SIZE = np.array([0.6, 0.64, 0.48])  # extents of every object over the diagonal
DIAGONAL = 0.2


def true_pose(side: float, camera: np.ndarray) -> np.ndarray:
    """Three metres away, to the left or right of the picture's middle, turned by as much."""
    c, s = np.cos(0.4 + side), np.sin(0.4 + side)
    pose = np.eye(4)
    # y of the object points up, that of the camera down.
    pose[:3, :3] = DIAGONAL * np.diag([1.0, -1, -1]) @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    pose[:3, 3] = 3 * np.linalg.inv(camera) @ [SHAPE[1] * (0.5 + side), SHAPE[0] / 2, 1]
    return pose


def write_frame(beginning: Path, real: bool, meta: str, sides: dict[int, float]) -> None:
    """The five files of a frame that shows ellipsoids, by their number in the mask."""
    beginning.parent.mkdir(parents=True, exist_ok=True)
    camera = np.array(REAL_INTRINSICS if real else CAMERA_INTRINSICS)
    rows, columns = np.indices(SHAPE)
    rays = np.stack([columns, rows, np.ones_like(rows)], -1) @ np.linalg.inv(camera).T
    mask, depth, coordinates = np.full(SHAPE, 255, np.uint8), np.zeros(SHAPE), np.ones((*SHAPE, 3))
    for number, side in sides.items():
        local = np.linalg.inv(true_pose(side, camera))
        # Where a ray through the ellipsoid's own space, squeezed to a sphere, meets it first.
        start, along = local[:3, 3] / (SIZE / 2), rays @ local[:3, :3].T / (SIZE / 2)
        a, b, c = (along**2).sum(-1), along @ start, start @ start - 1
        hit = b**2 > a * c
        distance = (-b - np.sqrt(np.where(hit, b**2 - a * c, 0))) / a
        surface = (start + distance[..., None] * along) * SIZE / 2
        mask[hit], depth[hit], coordinates[hit] = number, distance[hit], surface[hit] + 0.5
    stored = np.round(coordinates * 255).astype(np.uint8)
    stored[..., 2] = 255 - stored[..., 2]
    millimetres = np.round(depth * 1000).astype(np.uint16)
    opaque, nothing = np.full(SHAPE, 255, np.uint8), np.zeros(SHAPE, np.uint8)
    files = {"color": np.dstack([nothing, nothing + 100, nothing + 200])}
    if real:
        files |= {"depth": millimetres, "mask": mask, "coord": stored[..., ::-1]}
    else:
        coded = np.where(depth > 0, millimetres, 32001)
        files["depth"] = np.dstack([nothing, coded // 256, coded % 256, opaque]).astype(np.uint8)
        files["mask"] = np.dstack([nothing, nothing, mask, opaque])
        files["coord"] = np.dstack([stored[..., ::-1], opaque])
    for name, picture in files.items():
        assert cv2.imwrite(f"{beginning}_{name}.png", picture)
    Path(f"{beginning}_meta.txt").write_text(meta)


@pytest.fixture
def real(tmp_path):
    write_frame(tmp_path / "real/test/scene_1/0000", True, "1 6 mug_a_norm\n2 2 bowl_b_norm\n", {1: -0.25, 2: 0.25})
    models = tmp_path / "obj_models/real_test"
    models.mkdir(parents=True)
    (models / "mug_a_norm.txt").write_text("\n".join(str(float(side)) for side in 0.2 * SIZE))
    return tmp_path


@pytest.fixture
def camera(tmp_path):
    meta = "1 0 02954340 90c6\n2 5 03642806 b9eb\n4 1 02876657 ab67\n7 3 02942699 c9c9\n"
    write_frame(tmp_path / "camera/val/00000/0003", False, meta, {2: -0.25, 4: 0.25})
    folder = tmp_path / "obj_models/val/03642806/b9eb"
    folder.mkdir(parents=True)
    (folder / "bbox.txt").write_text("0.3 0.32 0.24\n-0.3 -0.32 -0.24\n")
    return tmp_path


def check_pose(pose, side, intrinsics, degrees=0.5, metres=5e-3):
    truth = true_pose(side, np.array(intrinsics))
    scale = np.cbrt(np.linalg.det(pose[:3, :3]))
    error = rotation_error(torch.from_numpy(pose[:3, :3] / scale), torch.from_numpy(truth[:3, :3] / DIAGONAL))
    assert float(error.rad2deg()) < degrees
    assert np.linalg.norm(pose[:3, 3] - truth[:3, 3]) < metres
    assert scale == pytest.approx(DIAGONAL, rel=0.02)


def test_a_real_frame_is_read_and_its_objects_posed_by_their_coordinates(real):
    frames = NOCSFrames(real, "real_test")
    assert len(frames) == 1
    frame = frames[0]
    assert frame.image[5, 5].tolist() == [200, 100, 0]
    assert frame.depth.max() < 3.05
    assert (frame.depth[frame.objects[0].mask] > 2.8).all()
    mug, bowl = frame.objects
    assert [(o.instance, o.category, o.model.name) for o in (mug, bowl)] == [
        (1, "mug", "mug_a_norm"),
        (2, "bowl", "bowl_b_norm"),
    ]
    check_pose(mug.pose, -0.25, REAL_INTRINSICS)
    check_pose(bowl.pose, 0.25, REAL_INTRINSICS)
    np.testing.assert_allclose(mug.size, SIZE / np.linalg.norm(SIZE))
    assert bowl.size is None
    assert mug.handle_visible
    rows, columns = np.nonzero(mug.mask)
    assert mug.box.tolist() == [rows.min(), columns.min(), rows.max() + 1, columns.max() + 1]
    assert mug.model.mesh == real / "obj_models/real_test/mug_a_norm.obj"


def test_a_camera_frame_codes_its_depth_in_colours_and_leaves_clutter_out(camera):
    frame = NOCSFrames(camera, "camera_val")[0]
    assert [(o.instance, o.category) for o in frame.objects] == [(2, "laptop"), (4, "bottle")]
    check_pose(frame.objects[0].pose, -0.25, CAMERA_INTRINSICS)
    np.testing.assert_allclose(frame.objects[0].size, SIZE, atol=1e-7)
    assert (frame.depth[~(frame.objects[0].mask | frame.objects[1].mask)] == 0).all()


def test_composed_depth_is_taken_where_it_is_at_hand(camera):
    composed = np.full(SHAPE, 1500, np.uint16)
    composed[0, 0] = 32001
    path = camera / "camera_full_depths/val/00000/0003_composed.png"
    path.parent.mkdir(parents=True)
    cv2.imwrite(str(path), composed)
    depth = NOCSFrames(camera, "camera_val")[0].depth
    assert depth[0, 0] == 0
    assert depth[1, 1] == pytest.approx(1.5)


def test_a_pickle_tells_poses_sizes_and_handles_of_the_objects_that_it_knows(camera):
    frame = NOCSFrames(camera, "camera_val")[0]
    pose = np.diag([2.0, 2, 2, 1])
    truth = {
        "gt_class_ids": np.array([1]),
        "gt_bboxes": frame.objects[1].box[None] + 1,
        "gt_RTs": pose[None],
        "gt_scales": np.array([[0.1, 0.2, 0.3]], np.float32),
        "handle_visibility": np.array([0.0]),
    }
    path = camera / "gts/val/results_val_00000_0003.pkl"
    path.parent.mkdir(parents=True)
    path.write_bytes(pickle.dumps(truth, protocol=3))
    laptop, bottle = NOCSFrames(camera, "camera_val")[0].objects
    np.testing.assert_array_equal(bottle.pose, pose)
    np.testing.assert_allclose(bottle.size, [0.1, 0.2, 0.3], rtol=1e-6)
    assert (laptop.handle_visible, bottle.handle_visible) == (True, False)
    check_pose(laptop.pose, -0.25, CAMERA_INTRINSICS)
    path.write_bytes(pickle.dumps({"gt_RTs": pose}, protocol=3))
    with pytest.raises(ValueError, match="must hold gt_class_ids, gt_bboxes, gt_RTs, gt_scales"):
        NOCSFrames(camera, "camera_val")[0]


def test_an_object_without_depth_has_no_pose(real):
    path = real / "real/test/scene_1/0000_depth.png"
    cv2.imwrite(str(path), np.zeros(SHAPE, np.uint16))
    assert [thing.pose for thing in NOCSFrames(real, "real_test")[0].objects] == [None, None]


def test_a_scan_of_the_validation_part_is_found_by_its_npz(tmp_path):
    beginning = tmp_path / "0000"
    write_frame(beginning, True, "1 6 mug_c.npz\n", {1: 0.0})
    np.savez(tmp_path / "mug_c.npz", scale=0.3 * SIZE)
    (mug,) = read_frame(beginning, np.array(REAL_INTRINSICS), models=tmp_path).objects
    np.testing.assert_allclose(mug.size, SIZE / np.linalg.norm(SIZE))
    assert mug.model.mesh == tmp_path / "mug_c_norm.obj"


def test_frames_that_lack_a_file_are_left_out_and_the_rest_is_sorted(real):
    for number in ("0002", "0001", "0003"):
        write_frame(real / f"real/test/scene_2/{number}", True, "1 6 mug_a_norm\n", {1: 0.0})
    (real / "real/test/scene_2/0001_coord.png").unlink()
    frames = NOCSFrames(real, "real_test")
    assert [path.name for path in frames.paths] == ["0000", "0002", "0003"]
    assert [frame.path.name for frame in frames[1:]] == ["0002", "0003"]


def test_mistakes_are_named(real, tmp_path):
    with pytest.raises(ValueError, match="split must be one of camera_train"):
        NOCSFrames(real, "test")
    with pytest.raises(FileNotFoundError, match="root must hold camera/train or CAMERA/train or train"):
        NOCSFrames(real, "camera_train")
    (real / "real/train/scene_1").mkdir(parents=True)
    with pytest.raises(ValueError, match=r"holds no frame with all of _color\.png"):
        NOCSFrames(real, "real_train")
    beginning = real / "real/test/scene_1/0000"
    cv2.imwrite(str(tmp_path / "grey.png"), np.zeros(SHAPE, np.uint8))
    with pytest.raises(ValueError, match="is no depth: 16-bit grey or 8-bit colours"):
        read_depth(tmp_path / "grey.png")
    with pytest.raises(FileNotFoundError, match=r"there is no file .*none.png"):
        read_depth(tmp_path / "none.png")
    cv2.imwrite(str(tmp_path / "small.png"), np.zeros((4, 4), np.uint16))
    with pytest.raises(ValueError, match="must have one size"):
        read_frame(beginning, np.array(REAL_INTRINSICS), full_depth=tmp_path / "small.png")
    (real / "obj_models/real_test/mug_a_norm.txt").write_text("1 2")
    with pytest.raises(ValueError, match="must hold 3 numbers of a box"):
        NOCSFrames(real, "real_test")[0]
    Path(f"{beginning}_meta.txt").write_text("mug\n")
    with pytest.raises(ValueError, match="must list instance, class and model on a line, got 'mug'"):
        NOCSFrames(real, "real_test")[0]
    Path(f"{beginning}_mask.png").write_text("no picture")
    with pytest.raises(ValueError, match="is not an image"):
        NOCSFrames(real, "real_test")[0]


def test_the_real_excerpts_meshes_lie_under_their_masks(dev_data):
    frame = NOCSFrames(dev_data / "nocs_sample", "real_train")[0]
    assert [thing.category for thing in frame.objects] == ["mug", "bowl", "bowl", "bottle", "can"]
    for thing in frame.objects:
        mesh = load_mesh(thing.model.mesh).vertices
        extents = mesh.max(0) - mesh.min(0)
        diagonal = np.linalg.norm(extents)
        np.testing.assert_allclose(thing.size, extents / diagonal, atol=1e-5)
        assert np.cbrt(np.linalg.det(thing.pose[:3, :3])) == pytest.approx(diagonal, rel=0.02)
        points = mesh / diagonal @ thing.pose[:3, :3].T + thing.pose[:3, 3]
        pixels = points @ frame.intrinsics.T
        columns, rows = np.round(pixels[:, :2] / pixels[:, 2:]).astype(int).T
        assert thing.mask[rows, columns].mean() > 0.9


def test_the_excerpts_pickle_agrees_with_the_alignment(dev_data):
    frames = NOCSFrames(dev_data / "nocs_sample", "camera_val")
    frame = frames[0]
    found = read_frame(frame.path, frame.intrinsics)
    for a, b in zip(frame.objects, found.objects, strict=True):
        np.testing.assert_allclose(a.pose, b.pose, atol=1e-6)
