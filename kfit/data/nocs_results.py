"""NOCS's result files: predictions and true objects of an image."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kfit.data.annotated_frame import AnnotatedFrame
from kfit.data.nocs_frame import NOCSFrame
from kfit.data.nocs_pickle import dump_pickle, load_pickle
from kfit.geometry import CATEGORIES


@dataclass(frozen=True)
class NOCSPrediction:
    """An object found in an image.

    Attributes:
        category: as `kfit.geometry.CATEGORIES` spells it.
        rotation: (3, 3) object to camera, OpenCV axes.
        translation: (3,) in metres.
        size: (3,) extents in metres.
        score: larger is more certain.
        box: (4,) in the image: top, left, bottom, right, the latter two just outside.
        mask: (H, W) or None.

    Example:
        >>> import numpy as np
        >>> from kfit.data import NOCSPrediction
        >>> pose = {"rotation": np.eye(3), "translation": np.array([0.0, 0.0, 1.0])}
        >>> found = NOCSPrediction("mug", **pose, size=np.full(3, 0.1), score=0.9, box=np.array([10, 20, 60, 80]))
        >>> found.category
        'mug'
    """

    category: str
    rotation: NDArray[np.floating]
    translation: NDArray[np.floating]
    size: NDArray[np.floating]
    score: float
    box: tuple[int, int, int, int]
    mask: NDArray[np.bool_] | None = None


def make_result(frame: NOCSFrame | AnnotatedFrame, predictions: Sequence[NOCSPrediction]) -> dict[str, Any]:
    """Return a frame's objects and predictions under the names of NOCS's detect_eval.py.

    ``image_path``; ``gt_class_ids`` (T,), ``gt_bboxes`` (T, 4), ``gt_RTs`` (T, 4, 4), ``gt_scales`` (T, 3),
    ``gt_handle_visibility`` (T,); ``pred_class_ids`` (P,), ``pred_bboxes``, ``pred_RTs``, ``pred_scales``,
    ``pred_scores`` (P,), and ``pred_masks`` (H, W, P) where every prediction has a mask. Poses are [s R | t] with s the
    box's diagonal in metres, scales the extents over it.

    Raises:
        ValueError: if an object of the frame has no pose or size.

    Example:
        >>> from kfit.data import NOCSFrames, make_result
        >>> frame = NOCSFrames("NOCS", "real_test")[0]  # doctest: +SKIP
        >>> make_result(frame, predictions)["pred_RTs"].shape  # doctest: +SKIP
    """
    for thing in frame.objects:
        if thing.pose is None or thing.size is None:
            what = "pose" if thing.pose is None else "size, which gts or obj_models would give"
            raise ValueError(f"object {thing.instance} of {frame.path}, a {thing.category}, has no {what}")
    result: dict[str, Any] = {
        "image_path": str(frame.path),
        "gt_class_ids": _ids([thing.category for thing in frame.objects]),
        "gt_bboxes": _stack([thing.box for thing in frame.objects], (4,), np.int32),
        "gt_RTs": _stack([thing.pose for thing in frame.objects], (4, 4), np.float64),
        "gt_scales": _stack([thing.size for thing in frame.objects], (3,), np.float32),
        "gt_handle_visibility": np.array([int(thing.handle_visible) for thing in frame.objects], np.int64),
        "pred_class_ids": _ids([found.category for found in predictions]),
        "pred_bboxes": _stack([found.box for found in predictions], (4,), np.int32),
        "pred_RTs": _stack([_similarity(found) for found in predictions], (4, 4), np.float64),
        "pred_scales": _stack([found.size / np.linalg.norm(found.size) for found in predictions], (3,), np.float32),
        "pred_scores": np.array([found.score for found in predictions], np.float32),
    }
    masks = [found.mask for found in predictions if found.mask is not None]
    if masks and len(masks) == len(predictions):
        result["pred_masks"] = np.stack(masks, -1).astype(np.uint8)
    return result


def write_result(folder: str | Path, result: dict[str, Any]) -> Path:
    """Write ``results_<split>_<scene>_<number>.pkl`` atomically, named by the image.

    Raises:
        ValueError: if the result has no ``image_path``.

    Example:
        >>> from kfit.data import read_results, result_files, write_result
        >>> result = {"image_path": "real/test/scene_1/0000", "gt_class_ids": [], "pred_class_ids": []}
        >>> path = write_result("results", result)
        >>> [file.name for file in result_files("results")]
        ['results_test_scene_1_0000.pkl']
        >>> [result["image_path"] for result in read_results(result_files("results"))]
        ['real/test/scene_1/0000']
    """
    if not isinstance(result.get("image_path"), str):
        raise ValueError("result must have an image_path, which names the file")
    path = Path(folder) / f"results_{'_'.join(Path(result['image_path']).parts[-3:])}.pkl"
    path.parent.mkdir(parents=True, exist_ok=True)
    dump_pickle(path, result)
    return path


def result_files(place: str | Path) -> list[Path]:
    """Return the result file itself, or the ``results_*.pkl`` of a folder, sorted.

    Raises:
        FileNotFoundError: if there is no such place, or the folder holds none.

    Example:
        >>> from kfit.data import result_files
        >>> result_files("missing")
        Traceback (most recent call last):
        FileNotFoundError: ...
    """
    place = Path(place)
    if place.is_file():
        return [place]
    if not place.is_dir():
        raise FileNotFoundError(f"there is no file or folder {place}")
    files = sorted(place.glob("results_*.pkl"))
    if not files:
        raise FileNotFoundError(f"{place} holds no results_*.pkl")
    return files


def read_results(files: Iterable[str | Path]) -> Iterator[dict[str, Any]]:
    """Yield the results of the images in files, each with its ``image_path``; a file may hold a list of them.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: if one is damaged, holds more than arrays and plain values, or no results.

    Example:
        >>> from kfit.data import read_results, write_result
        >>> result = {"image_path": "real/test/scene_1/0000", "gt_class_ids": [], "pred_class_ids": []}
        >>> path = write_result("results", result)
        >>> len(list(read_results([path])))
        1
    """
    for path in files:
        loaded = load_pickle(path)
        for result in loaded if isinstance(loaded, list) else [loaded]:
            if not isinstance(result, dict) or "gt_class_ids" not in result:
                raise ValueError(f"{path} holds no results of NOCS: a dict with gt_class_ids was expected")
            if "pred_class_ids" not in result:
                raise ValueError(f"{path} holds true poses but no predictions (pred_class_ids and so on)")
            result["image_path"] = str(result.get("image_path") or path)
            yield result


def _ids(names: list[str]) -> NDArray[np.int64]:
    return np.array([CATEGORIES[name].nocs_id for name in names], np.int64)


def _similarity(found: NOCSPrediction) -> NDArray[np.float64]:
    pose = np.eye(4)
    pose[:3, :3] = np.linalg.norm(found.size) * found.rotation
    pose[:3, 3] = found.translation
    return pose


def _stack(rows: list[Any], shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
    return np.stack(rows).astype(dtype) if rows else np.zeros((0, *shape), dtype)
