"""Fit the pose of an object whose mesh is known: a mug's CAD model, drawn softly, against one picture of it."""

import math
import sys

import torch
from skimage.io import imsave

import kfit
from kfit.callbacks import Pruning
from kfit.core import Observation
from kfit.data import build, pose_view
from kfit.energies import SSIM, Silhouette
from kfit.generators import MeshRenderer
from kfit.geometry import rotation_error, rotation_from_angles
from kfit.initializers import Constant, SphereGrid
from kfit.optimizers import Adam

# What is seen: an exact, lit rendering. What draws: the same mesh, splat and unlit.
mesh, light = build("mug", 3)
truth = torch.tensor([2.2, 0.5, 0.0])
view = pose_view(mesh, azimuth=float(truth[0]), elevation=float(truth[1]), light=light)
image, mask = torch.from_numpy(view.image).movedim(-1, 0)[None], torch.from_numpy(view.mask)[None, None]
generator = MeshRenderer(mesh.vertices, mesh.faces, mesh.uv, mesh.texture)

pipeline = kfit.FitPipeline(
    generator,
    energies={"silhouette": Silhouette(), "ssim": SSIM()},
    initializers=[
        SphereGrid(elevation_deg=(0, 60)),
        Constant({"roll": 0.0, "shift": [0.1, -0.1], "scale": 0.9}),
    ],
    optimizer=Adam({"azimuth": 0.03, "elevation": 0.02, "roll": 0.01, "shift": 0.02, "scale": 0.02}),
    weights={"silhouette": 5.0},
    callbacks=[Pruning({5: 6, 12: 2})],
    num_starts=16,
    num_steps=30,
)
result = pipeline(Observation(image, mask), seed=0)

found = rotation_from_angles(*(result.values[name] for name in ("azimuth", "elevation", "roll")))
error = math.degrees(float(rotation_error(found, rotation_from_angles(*truth)[None])))
shift = ", ".join(f"{32 * float(part):.1f}" for part in result.values["shift"][0])
print(f"rotation off by {error:.1f}°, shift ({shift}) pixels, scale {float(result.values['scale']):.2f}")

drawn = generator(**result.values)
panels = [image[0], drawn.image[0], mask[0].expand(3, -1, -1), drawn.mask[0].expand(3, -1, -1)]
path = sys.argv[1] if len(sys.argv) > 1 else "fit_known_mesh.png"
picture = (255 * torch.cat(panels, 2).clamp(0, 1)).byte().movedim(0, -1)
imsave(path, picture.numpy(), check_contrast=False)
print(f"seen and fitted, masks seen and fitted: {path}")
