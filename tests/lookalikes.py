"""Small data sets in the layouts of Wild6D, HouseCat6D, Objectron and BOP, with one mug of known pose each."""

import json
import pickle
import struct

import numpy as np
from skimage.io import imsave

from kfit.data import Light, build, render

SIZE, FOCAL = (96, 128), 150.0
K = np.array([[FOCAL, 0, 63.5], [0, FOCAL, 47.5], [0, 0, 1]])
DIAGONAL = 0.17


def mug():
    """A drawn mug: picture and mask, rotation and translation in OpenCV axes, and its size in metres."""
    mesh, _ = build("mug", 7)
    angle = 0.5
    rotation = np.array([[np.cos(0.4), 0, np.sin(0.4)], [0, 1, 0], [-np.sin(0.4), 0, np.cos(0.4)]])
    tilt = np.array([[1, 0, 0], [0, np.cos(angle), -np.sin(angle)], [0, np.sin(angle), np.cos(angle)]])
    world2cam = np.eye(4)
    world2cam[:3, :3] = tilt @ rotation
    world2cam[:3, 3] = 0.1, -0.05, -2.5
    view = render(mesh, world2cam, K, SIZE, Light.random(np.random.default_rng(0)))
    flip = np.diag([1.0, -1.0, -1.0])
    return view, flip @ world2cam[:3, :3], DIAGONAL * flip @ world2cam[:3, 3], DIAGONAL * mesh.extents.astype(float)


def save(path, picture):
    path.parent.mkdir(parents=True, exist_ok=True)
    imsave(path, picture, check_contrast=False)


def picture_of(view):
    return (255 * view.image).astype(np.uint8)


def mask_of(view):
    return (255 * (view.mask > 0.5)).astype(np.uint8)


def depth_of(view):
    return np.where(view.mask > 0.5, 1000 * DIAGONAL * view.depth, 0).astype(np.uint16)


def write_wild6d(root):
    view, rotation, translation, size = mug()
    images = root / "mug" / "0001" / "1" / "images"
    save(images / "0.jpg", picture_of(view))
    save(images / "0-mask.png", mask_of(view))
    save(images / "0-depth.png", depth_of(view))
    (images.parent / "metadata").write_text(json.dumps({"K": K.T.ravel().tolist(), "w": SIZE[1], "h": SIZE[0]}))
    annotation = {
        "name": "mug/0001/1/0",
        "class_id": 5,
        "rotation": -2 * rotation,
        "translation": translation,
        "size": size,
    }
    file = root / "pkl_annotations" / "mug" / "mug-0001-1.pkl"
    file.parent.mkdir(parents=True)
    file.write_bytes(pickle.dumps({"num_frames": 1, "annotations": [annotation]}))


def write_housecat6d(root):
    view, rotation, translation, size = mug()
    scene = root / "test_scene1"
    save(scene / "rgb" / "000000.png", picture_of(view))
    number = np.zeros((*SIZE, 3), np.uint8)
    number[view.mask > 0.5, 0] = 3  # red, which OpenCV has last
    save(scene / "instance" / "000000.png", number)
    save(scene / "depth" / "000000.png", depth_of(view))
    np.savetxt(scene / "intrinsics.txt", K)
    annotation = {
        "instance_ids": [3], "class_ids": [4], "rotations": rotation[None], "translations": translation[None],
        "gt_scales": size[None], "bboxes": np.array([[0, 0, 9, 9]]), "model_list": ["cup"],
    }  # fmt: skip
    (scene / "labels").mkdir()
    (scene / "labels" / "000000_label.pkl").write_bytes(pickle.dumps(annotation))


def varint(value):
    out = bytearray()
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    return bytes([*out, value])


def field(number, content):
    if isinstance(content, int):
        return varint(number << 3) + varint(content)
    return varint(number << 3 | 2) + varint(len(content)) + content


def floats(number, values):
    return field(number, struct.pack(f"<{len(values)}f", *values))


def write_objectron(root):
    """The camera's sensor lies on its side; the world is where the camera stands, turned a little and moved."""
    view, rotation, translation, size = mug()
    upright = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])
    turn = np.array([[np.cos(0.3), 0, np.sin(0.3)], [0, 1, 0], [-np.sin(0.3), 0, np.cos(0.3)]])
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = turn, (0.3, -0.2, 0.1)
    in_sensor, placed = upright.T @ rotation, upright.T @ translation
    sensor = np.array([[FOCAL, 0, K[1, 2]], [0, FOCAL, SIZE[1] - 1 - K[0, 2]], [0, 0, 1]])
    thing = (
        field(1, 1) + field(2, b"cup") + floats(4, (turn.T @ in_sensor).ravel())
        + floats(5, turn.T @ (placed - matrix[:3, 3])) + floats(6, size)
    )  # fmt: skip
    camera = field(5, SIZE[0]) + field(6, SIZE[1]) + floats(7, sensor.ravel()) + floats(9, matrix.ravel())
    root.mkdir(parents=True, exist_ok=True)
    (root / "annotation.pbdata").write_bytes(field(1, thing) + field(2, field(3, camera)))
    save(root / "images" / "0.jpg", picture_of(view))


def write_bop(root):
    """The model has z up and stands off its frame's origin."""
    view, rotation, translation, size = mug()
    to_category = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    sides = 1000 * np.abs(to_category.T) @ size
    low = np.array([10.0, -20.0, 30.0])
    rotated = rotation @ to_category
    moved = 1000 * translation - rotated @ (low + sides / 2)
    scene = root / "test" / "000001"
    save(scene / "rgb" / "000003.png", picture_of(view))
    save(scene / "mask_visib" / "000003_000000.png", mask_of(view))
    save(scene / "depth" / "000003.png", (10 * depth_of(view)).astype(np.uint16))
    annotation = {"3": [{"cam_R_m2c": rotated.ravel().tolist(), "cam_t_m2c": moved.tolist(), "obj_id": 14}]}
    (scene / "scene_gt.json").write_text(json.dumps(annotation))
    (scene / "scene_camera.json").write_text(json.dumps({"3": {"cam_K": K.ravel().tolist(), "depth_scale": 0.1}}))
    model = {
        f"{name}_{axis}": float(v)
        for name, row in (("min", low), ("size", sides))
        for axis, v in zip("xyz", row, strict=True)
    }
    (root / "models").mkdir()
    (root / "models" / "models_info.json").write_text(json.dumps({"14": model | {"diameter": 170.0}}))
    return rotated, moved
