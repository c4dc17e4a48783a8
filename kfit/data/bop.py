"""Data sets and results in the format of the BOP challenge."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kfit.core.arguments import check_arguments
from kfit.data.annotated_frame import AnnotatedFrame, AnnotatedObject
from kfit.data.annotated_frames import AnnotatedFrames
from kfit.data.mesh_places import MeshFile, stand_of
from kfit.data.nocs_frame import read_picture
from kfit.data.nocs_results import NOCSPrediction
from kfit.runtime.atomic_write import atomic_write

COLUMNS = ("scene_id", "im_id", "obj_id", "score", "R", "t", "time")
_LARGEST = 500_000_000
# A rotation's R R^T is that near to the identity, as files round; no camera sees objects within some millimetres.
_ROUNDED, _NEAREST_MM = 0.05, 10.0


@dataclass(frozen=True)
class BOPEstimate:
    """A row of results: the pose of an object of a data set in one of its images.

    Attributes:
        scene_id, im_id, obj_id: numbers of the scene, the image and the object.
        score: confidence; larger is more certain.
        rotation: (3, 3), model to camera in OpenCV axes.
        translation: (3,) in metres; files hold millimetres.
        time: seconds for the image; −1 if not measured.
    """

    scene_id: int
    im_id: int
    obj_id: int
    score: float
    rotation: NDArray[np.float64]
    translation: NDArray[np.float64]
    time: float = -1.0


class BOPFrames(AnnotatedFrames):
    """Images of a data set: ``SPLIT/SCENE/scene_gt.json``, ``scene_camera.json``, ``rgb`` or ``gray``, ``mask_visib``.

    Only objects with a category are read. Their poses are those of the boxes in models_info.json, in the category's
    axes; what is found in a frame is written as a file of results in the model's own frame again.

    Args:
        root: root of the data set.
        objects: category of each object's number, such as ``{14: mug}``.
        split: folder of scenes.
        stands: orientation of the models, ``UP`` or ``UP,FRONT`` as after a place of meshes; most of BOP's have z up.
    """

    def __init__(self, root: str, objects: dict[int, str], split: str = "test", stands: str = "z") -> None:
        check_arguments(BOPFrames, locals())
        self.root, self.objects, self.split = Path(root), {int(k): str(v) for k, v in objects.items()}, split
        up, front = stand_of(stands, f"stands {stands!r}")
        self.to_category = MeshFile(Path(), up=up, front=front).rotation
        self.truths = read_truths(self.root, split)
        self.images = sorted(
            key for key, things in self.truths.items() if any(one["obj_id"] in self.objects for one in things)
        )
        if not self.images:
            raise ValueError(f"{root}/{split} shows none of the objects {', '.join(map(str, self.objects))}")

    @property
    def categories(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(self.objects.values()))

    def __len__(self) -> int:
        return len(self.images)

    def result_name(self, index: int) -> str:
        scene, image = self.images[index]
        return f"{scene:06}_{image:06}.csv"

    def __getitem__(self, index: int) -> AnnotatedFrame:
        scene, number = self.images[index]
        folder = self.root / self.split / f"{scene:06}"
        cameras = _json(folder / "scene_camera.json")
        try:
            camera = cameras[str(number)]
            intrinsics = np.asarray(camera["cam_K"], float).reshape(3, 3)
            things = []
            for place, thing in enumerate(self.truths[scene, number]):
                if (kind := thing["obj_id"]) not in self.objects:
                    continue
                mask = read_picture(folder / "mask_visib" / f"{number:06}_{place:06}.png", 0) > 0
                if mask.any():
                    low, size = self._box(kind)
                    rotation = np.asarray(thing["cam_R_m2c"], float).reshape(3, 3)
                    centre = rotation @ (low + size / 2) + np.asarray(thing["cam_t_m2c"], float)
                    rotated, sides = rotation @ self.to_category.T, np.abs(self.to_category) @ size
                    things.append(
                        AnnotatedObject.of(
                            place,
                            self.objects[kind],
                            rotated,
                            centre / 1000,
                            sides / 1000,
                            intrinsics,
                            mask,
                        )
                    )
            depth_unit = float(camera.get("depth_scale", 1.0)) / 1000
        except (KeyError, TypeError) as error:
            raise ValueError(f"{folder} has not all of image {number}: {error}") from None
        pictures = [folder / kind / f"{number:06}{end}" for kind in ("rgb", "gray") for end in (".png", ".jpg", ".tif")]
        picture = next((path for path in pictures if path.is_file()), pictures[0])
        depth = folder / "depth" / f"{number:06}.png"
        where = Path(self.split, f"{scene:06}", f"{number:06}")
        return AnnotatedFrame(where, picture, intrinsics, tuple(things), depth if depth.is_file() else None, depth_unit)

    def write(self, path: Path, frame: AnnotatedFrame, found: Sequence[NOCSPrediction]) -> None:
        """Write a file of results; an answer is assigned to the nearest box of its category in the frame."""
        scene, number = int(frame.path.parts[-2]), int(frame.path.parts[-1])
        rows = []
        for one in found:
            same = [thing for thing in frame.objects if thing.category == one.category]
            nearest = min(same, key=lambda thing: float(np.abs(thing.box - np.asarray(one.box)).sum()))
            kind = self.truths[scene, number][nearest.instance]["obj_id"]
            low, size = self._box(kind)
            rotation = one.rotation @ self.to_category
            translation = one.translation - rotation @ (low + size / 2) / 1000
            rows.append(BOPEstimate(scene, number, kind, one.score, rotation, translation))
        write_bop_results(path, rows)

    def _box(self, kind: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lower corner and sides (3,) of a model's box, in millimetres."""
        model = self._models[str(kind)]
        return (np.array([float(model[f"{name}_{axis}"]) for axis in "xyz"]) for name in ("min", "size"))  # type: ignore[return-value]

    @cached_property
    def _models(self) -> Mapping[str, Any]:
        return read_models(self.root)


def read_truths(root: Path, split: str) -> dict[tuple[int, int], list[dict[str, Any]]]:
    """Read the true poses of a split: the entries of scene_gt.json by scene and image.

    Raises:
        FileNotFoundError, ValueError: If there are none, or a file has another content.
    """
    found: dict[tuple[int, int], list[dict[str, Any]]] = {}
    for file in sorted((root / split).glob("[0-9]*/scene_gt.json")):
        for number, things in _json(file).items():
            if not isinstance(things, list) or not all(isinstance(one, dict) and "obj_id" in one for one in things):
                raise ValueError(f"{file} holds no poses of image {number}")
            found[int(file.parent.name), int(number)] = things
    if not found:
        raise FileNotFoundError(f"{root / split} holds no scenes of BOP: no NUMBER/scene_gt.json")
    return found


def read_models(root: Path) -> Mapping[str, Any]:
    """Read each object's box, diameter and symmetries from models_info.json, in millimetres."""
    files = [root / folder / "models_info.json" for folder in ("models_eval", "models")]
    return _json(next((file for file in files if file.is_file()), files[-1]))


def write_bop_results(path: str | Path, estimates: Iterable[BOPEstimate]) -> None:
    """Write a file of results atomically."""
    lines = [",".join(COLUMNS)]
    for one in estimates:
        rotation, translation = (
            " ".join(f"{x:.9g}" for x in np.ravel(v)) for v in (one.rotation, 1000 * one.translation)
        )
        lines.append(f"{one.scene_id},{one.im_id},{one.obj_id},{one.score:.6g},{rotation},{translation},{one.time:g}")
    path, text = Path(path), "\n".join(lines) + "\n"
    atomic_write(path.parent, {path.name: lambda place: place.write_text(text)})


def read_bop_results(path: str | Path) -> list[BOPEstimate]:
    """Read a file of results.

    Raises:
        FileNotFoundError: if there is none.
        ValueError: If a line cannot be read or holds no pose, which the message names, or translations are in metres.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    if path.stat().st_size > _LARGEST:
        raise ValueError(f"{path} has {path.stat().st_size:,} bytes, more than {_LARGEST:,}")
    found = []
    with path.open(newline="", encoding="utf-8", errors="replace") as file:
        for number, row in enumerate(csv.reader(file), 1):
            if not row or [cell.strip() for cell in row] == list(COLUMNS):
                continue
            try:
                scene, image, kind = (int(cell) for cell in row[:3])
                rotation, translation = (np.array([float(x) for x in cell.split()]) for cell in row[4:6])
                one = BOPEstimate(
                    scene, image, kind, float(row[3]), rotation.reshape(3, 3), translation / 1000, float(row[6])
                )
                _check_estimate(one)
            except (ValueError, IndexError) as error:
                raise ValueError(f"{path}, line {number} is no result of BOP ({','.join(COLUMNS)}): {error}") from None
            found.append(one)
    lengths = [1000 * float(np.linalg.norm(one.translation)) for one in found]
    if lengths and max(lengths) < _NEAREST_MM:
        raise ValueError(f"{path}: t must be in millimetres, but no object is farther than {max(lengths):.2g} mm")
    return found


def _check_estimate(one: BOPEstimate) -> None:
    if one.translation.shape != (3,) or not np.isfinite(one.translation).all() or not math.isfinite(one.score):
        raise ValueError("t must hold three finite numbers, and the score be finite")
    off = np.abs(one.rotation @ one.rotation.T - np.eye(3)).max()
    if not (off < _ROUNDED and np.linalg.det(one.rotation) > 0):
        raise ValueError("R is no rotation")


def _json(file: Path) -> Mapping[str, Any]:
    if not file.is_file():
        raise FileNotFoundError(f"there is no file {file}")
    if file.stat().st_size > _LARGEST:
        raise ValueError(f"{file} has {file.stat().st_size:,} bytes, more than {_LARGEST:,}")
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{file} is no JSON file: {error}") from None
    if not isinstance(content, dict):
        raise ValueError(f"{file} must hold an object of JSON, got {type(content).__name__}")
    return content
