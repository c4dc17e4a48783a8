"""Find the pose of an object with a CAD model: its mesh, drawn softly, is fitted to one picture.

    python examples/fit_known_mesh.py [FOLDER]

Writes FOLDER/fit_known_mesh.png: the observation, the best start, and the fit. FOLDER is kfit_out by default.
"""

import math
import sys
from pathlib import Path

import torch

import kfit
from kfit.callbacks import Pruning
from kfit.core import Observation
from kfit.data import build, pose_view
from kfit.energies import SSIM, Silhouette
from kfit.generators import MeshRenderer
from kfit.geometry import rotation_error, rotation_from_angles
from kfit.initializers import Constant, SphereGrid
from kfit.optimizers import Adam
from kfit.reports.picture_table import picture_table

# What is seen: an exact, lit rendering. What draws: the same mesh, splat and unlit.
mesh, light = build("camera", 1_006_001, held_out=True)
elevation, azimuth = torch.tensor(0.5), torch.tensor(2.2)
view = pose_view(mesh, float(elevation), float(azimuth), light)
image, mask = torch.from_numpy(view.image).movedim(-1, 0)[None], torch.from_numpy(view.mask)[None, None]
generator = MeshRenderer(mesh.vertices, mesh.faces, mesh.uv, mesh.texture)

pipeline = kfit.FitPipeline(
    generator,
    energies={"outline": Silhouette(), "structure": SSIM()},
    weights={"outline": 5.0},
    initializers=[SphereGrid(elevation_deg=(0, 60)), Constant({"roll": 0.0, "shift": [0.1, -0.1], "scale": 0.9})],
    optimizer=Adam({"azimuth": 0.03, "elevation": 0.02, "roll": 0.01, "shift": 0.02, "scale": 0.02}),
    callbacks=[Pruning({5: 6, 12: 2})],
    num_starts=16,
    num_steps=30,
)
result = pipeline(Observation(image, mask), seed=0)

found = rotation_from_angles(*(result.values[name] for name in ("azimuth", "elevation", "roll")))
error = math.degrees(float(rotation_error(found, rotation_from_angles(azimuth, elevation, torch.tensor(0.0)))))
print(f"rotation off by {error:.1f}°, scale {float(result.values['scale']):.2f} of 1")

start = generator(**{name: value[0, :, int(result.start)] for name, value in result.history.values.items()})
drawn = generator(**result.values)
half = torch.cat([image[..., :32], drawn.image[..., 32:]], 3)
fitted = f"fitted, off by {error:.1f}°"
columns = {"seen": image, "best start": start.image, fitted: drawn.image, "left half seen, right half fitted": half}
path = Path(sys.argv[1] if len(sys.argv) > 1 else "kfit_out") / "fit_known_mesh.png"
path.parent.mkdir(parents=True, exist_ok=True)
picture_table(columns).savefig(path)
print(path)
