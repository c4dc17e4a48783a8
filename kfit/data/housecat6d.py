"""HouseCat6D: scenes of household objects with polarised pictures, depth and poses (Jung et al., CVPR 2024)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kfit.core.arguments import check_arguments
from kfit.data.annotated_frame import WORDS, AnnotatedFrame, AnnotatedObject
from kfit.data.annotated_frames import AnnotatedFrames
from kfit.data.nocs_frame import read_picture
from kfit.data.nocs_pickle import load_pickle

CLASSES = ("box", "bottle", "can", "cup", "remote", "teapot", "cutlery", "glass", "tube", "shoe")
"""Names of class ids 1 to 10."""


class HouseCat6DFrames(AnnotatedFrames):
    """Frames ``SCENE/rgb/N.png`` with ``labels/N_label.pkl``, ``instance/N.png``, ``depth/N.png`` and intrinsics.txt.

    Objects keep the data set's axes, with y up; a cup is called a mug.

    Args:
        root: folder of the scenes.
        scenes: pattern of their names, such as ``test_scene*``.
    """

    def __init__(self, root: str, scenes: str = "*scene*") -> None:
        check_arguments(HouseCat6DFrames, locals())
        self.root = Path(root)
        self.pictures = sorted(self.root.glob(f"{scenes}/rgb/*.png"))
        if not self.pictures:
            raise FileNotFoundError(f"{root} holds no frames: no {scenes}/rgb/*.png")

    def __len__(self) -> int:
        return len(self.pictures)

    def result_name(self, index: int) -> str:
        picture = self.pictures[index]
        return f"results_{picture.parent.parent.name}_{picture.stem}.pkl"

    def __getitem__(self, index: int) -> AnnotatedFrame:
        picture = self.pictures[index]
        scene, stem = picture.parent.parent, picture.stem
        label = load_pickle(scene / "labels" / f"{stem}_label.pkl")
        try:
            intrinsics = _intrinsics(scene / "intrinsics.txt")
            numbers = read_picture(scene / "instance" / f"{stem}.png")[..., 2]
            names = ("instance_ids", "class_ids", "rotations", "translations", "gt_scales")
            rows = list(zip(*(np.asarray(label[name]) for name in names), strict=True))
            things = tuple(
                AnnotatedObject.of(
                    int(instance), _name(int(kind)), rotation, translation, size, intrinsics, numbers == instance
                )
                for instance, kind, rotation, translation, size in rows
                if (numbers == instance).any()
            )
        except (KeyError, TypeError, IndexError) as error:
            raise ValueError(f"{picture} has no labels of HouseCat6D: {error}") from None
        depth = scene / "depth" / f"{stem}.png"
        where = Path(scene.parent.name, scene.name, stem)
        return AnnotatedFrame(where, picture, intrinsics, things, depth if depth.is_file() else None)


def _intrinsics(file: Path) -> NDArray[np.float64]:
    if not file.is_file():
        raise FileNotFoundError(f"there is no file {file}")
    try:
        return np.loadtxt(file).reshape(3, 3)
    except ValueError as error:
        raise ValueError(f"{file} holds no intrinsics of three rows: {error}") from None


def _name(kind: int) -> str:
    name = CLASSES[kind - 1] if 1 <= kind <= len(CLASSES) else f"class {kind}"
    return WORDS.get(name, name)
