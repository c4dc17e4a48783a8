"""Find a mug's pose from colour alone and with a depth camera, and see what depth changes: how far away the mug is.

    python examples/pose_with_depth.py [FOLDER]

Writes FOLDER/pose_with_depth.png: the pose, and both answers from the side. FOLDER is kfit_out by default.
"""

import sys
from pathlib import Path

import numpy as np
import torch
from matplotlib.figure import Figure

import kfit
from kfit.data import build, pose_view
from kfit.data.rasterizer import DISTANCE, standard_intrinsics
from kfit.geometry import EDGES, box_corners
from kfit.reports import draw_overlay

# A mug of a kind that the model has never seen, a fifth smaller than most, as an RGB-D camera sees it: what is measured
# of it misses by 3 mm, and a tenth is missing.
model, rng = kfit.load("mug"), np.random.default_rng(0)
diagonal = 0.8 * model.card.mean_diagonal
mesh, light = build("mug", 1_000_002, held_out=True)
view, camera = pose_view(mesh, 0.45, 0.7, light, image_size=320), standard_intrinsics(320)
depth = diagonal * view.depth + rng.normal(0, 0.003, view.depth.shape)
depth[(view.mask < 1) | (rng.random(depth.shape) < 0.1)] = 0

answers = {
    "colour alone": model.pose(view.image, view.mask, intrinsics=camera),
    "with depth": model.pose(view.image, view.mask, intrinsics=camera, depth=depth),
}

figure = Figure(figsize=(10, 4), dpi=144, layout="constrained")
photo, side = figure.subplots(1, 2, width_ratios=(1, 1.6))
best = answers["with depth"]
photo.axis("off")
photo.imshow(draw_overlay(best.image, best.rotation, best.translation, best.size, camera, mask=best.mask))

# From the side, the camera at the left: the points that were measured, and both boxes.
truth, (rows, columns) = 100 * diagonal * DISTANCE, np.nonzero(depth)
away = 100 * depth[rows, columns]
side.scatter(away, away * (camera[1, 2] - rows) / camera[1, 1], s=1, color="0.75", label="measured by the depth camera")
side.plot(truth, 0, "k+", markersize=12, label=f"the mug's centre, {truth:.1f} cm away")
for (name, answer), color in zip(answers.items(), ("#ee6677", "#4477aa"), strict=True):
    found = 100 * float(answer.translation[2])
    line = f"{name}: {found:.1f} cm, off by {abs(found - truth):.1f} cm"
    pose = (torch.from_numpy(part) for part in (answer.rotation, answer.translation, answer.size))
    for edge in 100 * box_corners(*pose)[torch.tensor(EDGES)]:
        side.plot(edge[:, 2], -edge[:, 1], color=color, lw=1)
    side.plot([], [], color=color, label=line)
    print(line)
side.set(xlabel="distance from the camera [cm]", ylabel="height [cm]", aspect="equal", title="seen from the side")
figure.legend(loc="outside lower center", ncols=4, fontsize=8, frameon=False)
path = Path(sys.argv[1] if len(sys.argv) > 1 else "kfit_out") / "pose_with_depth.png"
path.parent.mkdir(parents=True, exist_ok=True)
figure.savefig(path)
print(path)
