"""How well a model finds the objects of NOCS's frames, given their true masks."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import get_args

import numpy as np
import torch

from kfit.data import NOCSFrame, NOCSFrames, NOCSObject
from kfit.data.nocs_frames import Split
from kfit.fitting.pipeline import FitPipeline
from kfit.metrics import rotation_error_deg, translation_error_cm
from kfit.metrics.nocs_objects import nocs_symmetry
from kfit.pose.category_model import CategoryModel
from kfit.pose.result import PoseResult


@dataclass(frozen=True)
class KnownObject:
    """An object of a frame whose true pose is known.

    Attributes:
        split: part of the data.
        frame: frame in which it is seen.
        thing: the object itself.
    """

    split: Split
    frame: NOCSFrame = field(repr=False)
    thing: NOCSObject

    @property
    def name(self) -> str:
        """``real_train scene_1/0000 3``: part of the data, scene and frame, number in the mask."""
        return f"{self.split} {'/'.join(self.frame.path.parts[-2:])} {self.thing.instance}"


def known_objects(root: str | Path, categories: Iterable[str]) -> Iterator[KnownObject]:
    """Objects of some categories in all frames below a folder, see `kfit.data.NOCSFrames`, whose pose is known.

    Raises:
        FileNotFoundError: if the folder holds no part of the data.
    """
    categories, parts = set(categories), []
    for split in get_args(Split):
        try:
            parts.append(NOCSFrames(root, split))
        except FileNotFoundError:
            continue
    if not parts:
        raise FileNotFoundError(f"{root} holds none of {', '.join(get_args(Split))} in the folders of NOCS's data")
    for part in parts:
        for frame in part:
            for thing in frame.objects:
                if thing.category in categories and thing.pose is not None:
                    yield KnownObject(part.split, frame, thing)


def fit_known(
    model: CategoryModel, known: KnownObject, pipeline: FitPipeline, depth: bool
) -> tuple[PoseResult, float, float] | None:
    """The model's answer, its rotation error in degrees and its translation error in centimetres.

    The rotation is measured as by NOCS (`kfit.metrics.nocs_objects.nocs_symmetry`).

    Args:
        model: model of the object's category.
        known: object in the frame, with its true mask.
        pipeline: the model's own, with or without depth.
        depth: whether the frame's depth is given, too.

    Returns:
        None where depth is asked for and unknown all over the object.

    Raises:
        ValueError: if the object's pose is unknown.
    """
    frame, thing = known.frame, known.thing
    if thing.pose is None:
        raise ValueError(f"{known.name} has no known pose")
    if depth and not (frame.depth[thing.mask] > 0).any():
        return None
    scaled = thing.pose[:3, :3]
    truth, place = scaled / np.cbrt(np.linalg.det(scaled)), thing.pose[:3, 3]
    away = frame.depth if depth else None
    found = model.pose(frame.image, thing.mask, intrinsics=frame.intrinsics, depth=away, pipeline=pipeline)
    symmetry = nocs_symmetry(thing.category, thing.handle_visible)
    rotation_deg = rotation_error_deg(torch.from_numpy(found.rotation), torch.from_numpy(truth), symmetry)
    moved = translation_error_cm(torch.from_numpy(found.translation), torch.from_numpy(place))
    return found, float(rotation_deg), float(moved)
