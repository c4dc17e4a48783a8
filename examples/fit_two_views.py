"""Find the pose of a known mesh from two photos by calibrated cameras, 40° apart, with cluttered background.

    python examples/fit_two_views.py [FOLDER]

Photos are cut out by their masks, so that clutter does not count. FOLDER/fit_two_views.png shows them and the answer.
"""

import sys
from pathlib import Path

import torch
import torch.nn.functional as F
from skimage import data

from kfit import FitPipeline, Observation
from kfit.callbacks import Pruning
from kfit.core import SO3
from kfit.data import build
from kfit.energies import L2, Silhouette
from kfit.generators import MeshInCamera
from kfit.geometry import rotation_error
from kfit.initializers import Constant
from kfit.optimizers import Adam
from kfit.reports.picture_table import picture_table

mesh, _ = build("mug", 7)  # any mesh: 15 cm across here
camera = torch.tensor([[190.0, 0.0, 47.5], [0.0, 190.0, 35.5], [0.0, 0.0, 1.0]])  # pictures of 96 × 72
generator = MeshInCamera(0.15 * mesh.vertices, mesh.faces, mesh.uv, mesh.texture, (72, 96), num_points=4000)
# The second camera stands 45° to the side and looks at the same place, 0.6 m in front of the first.
aside, middle, second = SO3().to_value(torch.tensor([0.0, 0.25, 0.0])), torch.tensor([0.0, 0.0, 0.6]), torch.eye(4)
second[:3, :3], second[:3, 3] = aside, middle - aside @ middle
cameras = {"intrinsics": camera.expand(2, 3, 3), "trans_cam_ref": torch.stack([torch.eye(4), second])}
rotation = SO3().to_value(torch.tensor([[0.85, 0.1, -0.05]]))
truth = {"rotation": rotation, "translation": torch.tensor([[0.02, -0.01, 0.58]])}
observed = generator(**truth, **{name: value[None] for name, value in cameras.items()})
clutter = F.interpolate(torch.from_numpy(data.coffee()).permute(2, 0, 1).float()[None] / 255, (72, 96), mode="area")
mask = observed.field("mask")
photos, cut_out = (observed.image * mask + ground * (1 - mask) for ground in (clutter, torch.ones(1)))
away = rotation[0] @ SO3().to_value(torch.tensor([0.0, 40 / 180, 0.0]))
fit = FitPipeline(
    generator,
    {"outline": Silhouette(), "color": L2()},
    weights={"color": 5.0},
    initializers=[Constant({"rotation": away.tolist(), "translation": [0.02, 0.0, 0.62]}, sigma={"rotation": 0.2})],
    optimizer=Adam({"rotation": 0.01, "translation": 0.004}, decay=0.96),
    callbacks=[Pruning({14: 6, 24: 2})],
    num_starts=16,
    num_steps=45,
)
intrinsics, poses = cameras["intrinsics"], cameras["trans_cam_ref"]
found = fit(Observation(cut_out, mask, views=2, intrinsics=intrinsics, trans_cam_ref=poses), seed=0).values
degrees = torch.rad2deg(rotation_error(found["rotation"], rotation)).item()
millimetres = 1000 * (found["translation"] - truth["translation"]).norm().item()
print(f"rotation off by {degrees:.1f}°, position by {millimetres:.1f} mm")
drawn = generator(**found, **{name: value[None] for name, value in cameras.items()}).image
path = Path(sys.argv[1] if len(sys.argv) > 1 else "kfit_out") / "fit_two_views.png"
path.parent.mkdir(parents=True, exist_ok=True)
picture_table({"photos": photos, "cut out": cut_out, "fitted": drawn}).savefig(path)
print(path)
