"""Find the pose of an object with a CAD model in a cluttered photo by a calibrated camera, from 40° away.

    python examples/fit_known_mesh.py [FOLDER]

A camera is rendered into the coffee photo. Its box is known, kfit's network cuts it out, and its mesh is fitted. Writes
FOLDER/fit_known_mesh.png: photo, mask, guess and fit. FOLDER is kfit_out by default.
"""

import sys
from pathlib import Path

import numpy as np
import torch
from skimage.data import coffee
from skimage.transform import resize

import kfit
from kfit.core import SO3, Observation
from kfit.data import build, render
from kfit.energies import SSIM, Silhouette
from kfit.generators import MeshInCamera
from kfit.geometry import intrinsics_from_fov, rotation_error, rotation_from_angles
from kfit.initializers import Constant
from kfit.optimizers import Adam
from kfit.pose.object_finder import box_of
from kfit.reports.picture_table import picture_table
from kfit.segmentation import ObjectMask

# The photo: the mesh by an exact, lit renderer, in front of a cup on a table.
(mesh, light), camera = build("camera", 1_006_001, held_out=True), intrinsics_from_fov(300, 200)
upright = rotation_from_angles(torch.tensor(2.2), torch.tensor(0.5), torch.tensor(0.0))
truth, to_opencv, place = torch.eye(4), torch.tensor([1.0, -1.0, -1.0]), torch.tensor([0.9, -0.1, 2.8])
truth[:3, :3], truth[:3, 3] = upright, to_opencv * place
view = render(mesh, truth.double().numpy(), camera.double().numpy(), (200, 300), light)
photo = resize(coffee(), (200, 300)).astype(np.float32)
photo += view.mask[..., None] * (view.image - photo)
box = box_of(view.mask)
image = torch.from_numpy(photo).movedim(-1, 0)[None]
mask = torch.from_numpy(ObjectMask()(photo, "camera", box).mask)[None, None]
generator = MeshInCamera(mesh.vertices, mesh.faces, mesh.uv, mesh.texture, (200, 300), camera)
rotation = to_opencv[:, None] * upright
guess = {"rotation": rotation @ SO3().to_value(torch.tensor([0.0, 40 / 180, 0.0])), "translation": 1.1 * place}
initializer = Constant({name: value.tolist() for name, value in guess.items()}, sigma={"rotation": 0.15})
optimizer = Adam({"rotation": 0.01, "translation": 0.03}, decay=0.96)
energies = {"outline": Silhouette(), "structure": SSIM()}
pipeline = kfit.FitPipeline(
    generator, energies, [initializer], optimizer, {"outline": 5.0}, num_starts=4, num_candidates=64, num_steps=40
)
cut_out = image * mask + 1 - mask  # on white, as meshes are drawn
found = pipeline(Observation(cut_out, mask), seed=0).values
shown = {"photo": image, "cut out": cut_out}
for words, pose in (("guess", {name: value[None] for name, value in guess.items()}), ("fitted", found)):
    drawn, error = generator(**pose), float(rotation_error(pose["rotation"][0], rotation).rad2deg())
    shown[f"{words}, off by {error:.1f}°"] = image + drawn.field("mask") * (drawn.image - image)
    print(f"{words}, off by {error:.1f}°")
path = Path(sys.argv[1] if len(sys.argv) > 1 else "kfit_out") / "fit_known_mesh.png"
path.parent.mkdir(parents=True, exist_ok=True)
picture_table(shown).savefig(path)
print(path)
