"""Find a mug's pose from one photo and from two photos by known cameras: the second determines size and distance.

    python examples/pose_two_photos.py [FOLDER]

Writes FOLDER/pose_two_photos.png: both photos with their common pose. FOLDER is kfit_out by default.
"""

import sys
from pathlib import Path

import numpy as np
import torch
from skimage.io import imsave

import kfit
from kfit.data import build, pose_view
from kfit.data.rasterizer import DISTANCE, standard_intrinsics
from kfit.geometry import rotation_from_angles, to_opencv
from kfit.reports import draw_overlay

# A mug of a kind that the model has never seen, a fifth smaller than most. The second camera stands 50° to the side.
model, size = kfit.load("mug"), 320
diagonal, camera = 0.8 * model.card.mean_diagonal, standard_intrinsics(size)
mesh, light = build("mug", 1_000_002, held_out=True)
views, poses = [], []
for azimuth, elevation in ((0.7, 0.45), (1.57, 0.4)):
    views.append(pose_view(mesh, elevation, azimuth, light, image_size=size))
    pose = np.eye(4)
    angles = (torch.tensor(angle).double() for angle in (azimuth, elevation, 0.0))
    pose[:3, :3], pose[2, 3] = to_opencv(rotation_from_angles(*angles)), DISTANCE * diagonal
    poses.append(pose)
# Points in the first camera to each camera.
relative = np.stack([pose @ np.linalg.inv(poses[0]) for pose in poses])

one = model.pose(views[0].image, views[0].mask, intrinsics=camera)
two = model.pose(
    [view.image for view in views], [view.mask for view in views], intrinsics=camera, relative_poses=relative
)
for name, answer in {"one photo": one, "two photos": two}.items():
    away, longest = 100 * abs(answer.translation[2] - poses[0][2, 3]), 100 * np.linalg.norm(answer.size)
    print(f"{name}: distance off by {away:.1f} cm, diagonal {longest:.1f} cm of {100 * diagonal:.1f}")

pictures = []
for view, pose in zip(views, relative, strict=True):
    rotation, translation = pose[:3, :3] @ two.rotation, pose[:3, :3] @ two.translation + pose[:3, 3]
    pictures.append(draw_overlay(view.image, rotation, translation, two.size, camera, mask=view.mask))
path = Path(sys.argv[1] if len(sys.argv) > 1 else "kfit_out") / "pose_two_photos.png"
path.parent.mkdir(parents=True, exist_ok=True)
imsave(path, np.concatenate(pictures, 1), check_contrast=False)
print(path)
