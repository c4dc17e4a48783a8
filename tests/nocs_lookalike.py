"""A look-alike of NOCS's data on disk, small and quickly written."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from kfit.data import dump_pickle
from kfit.geometry import CATEGORIES

SHAPE = (48, 80)
SIZE = np.array([0.6, 0.64, 0.48])  # extents over the diagonal


def write_frames(root: Path, scenes: Sequence[Sequence[str]]) -> None:
    """REAL275's test part: a frame for each tuple of categories, whose discs lie side by side, with true poses."""
    rng = np.random.default_rng(0)
    for number, categories in enumerate(scenes):
        beginning = root / f"real/test/scene_{1 + number % 2}/{number:04d}"
        beginning.parent.mkdir(parents=True, exist_ok=True)
        mask = np.full(SHAPE, 255, np.uint8)
        boxes = []
        for instance in range(1, len(categories) + 1):
            middle = (int(80 * (instance - 0.5) / len(categories)), 24)
            disc = cv2.circle(np.zeros(SHAPE, np.uint8), middle, 9 + instance, 1, -1) > 0
            mask[disc] = instance
            rows, columns = np.nonzero(mask == instance)
            boxes.append([rows.min(), columns.min(), rows.max() + 1, columns.max() + 1])
        noise = rng.integers(0, 255, (*SHAPE, 3), np.uint8)
        depth = np.where(mask == 255, 1500, 900).astype(np.uint16)
        pictures = {"color": noise, "coord": noise, "mask": cv2.merge([mask] * 3), "depth": depth}
        for name, picture in pictures.items():
            assert cv2.imwrite(f"{beginning}_{name}.png", picture)
        ids = [CATEGORIES[category].nocs_id for category in categories]
        meta = [f"{k} {number} {name}_norm" for k, (number, name) in enumerate(zip(ids, categories, strict=True), 1)]
        Path(f"{beginning}_meta.txt").write_text("".join(line + "\n" for line in meta))
        pose = np.diag([0.2, -0.2, -0.2, 1.0])
        pose[2, 3] = 0.9
        truth = {
            "gt_class_ids": np.array(ids, np.int64),
            "gt_bboxes": np.array(boxes, np.int32).reshape(-1, 4),
            "gt_RTs": np.tile(pose, (len(ids), 1, 1)),
            "gt_scales": np.tile(SIZE, (len(ids), 1)),
        }
        gts = root / "gts/real_test"
        gts.mkdir(parents=True, exist_ok=True)
        dump_pickle(gts / f"results_real_test_{beginning.parent.name}_{beginning.name}.pkl", truth)
