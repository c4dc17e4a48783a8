"""Write the mesh of an object in a photo: the surface of the fitted volume, in metres, for any viewer or simulator.

    python examples/mesh_of_an_object.py [FOLDER]

Writes FOLDER/mug.glb, and FOLDER/mesh_of_an_object.png: the photo, and the mesh from the same camera and from two other
directions. FOLDER is kfit_out by default.
"""

import sys
from pathlib import Path

import torch

import kfit
from kfit.core import SO3
from kfit.data import build, pose_view
from kfit.generators import MeshInCamera
from kfit.reports.mesh_file import write_mesh
from kfit.reports.picture_table import picture_table

mesh, light = build("mug", 1_006_004, held_out=True)
view = pose_view(mesh, 0.5, 0.6, light, 128)
result = kfit.load("mug").pose(view.image, mask=view.mask)

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "kfit_out")
write_mesh(result, folder / "mug.glb")
found = result.mesh()
box, extents = (" × ".join(f"{side:.3f}" for side in sides) for sides in (result.size, found.extents))
print(f"{len(found.faces)} triangles, closed: {found.is_watertight}; {extents} m in a fitted box of {box} m")

# A texture of one pixel a triangle draws the triangles' colours.
count, colors = len(found.faces), torch.as_tensor(found.visual.face_colors[None, :, :3].copy())
corners = torch.as_tensor(found.triangles.copy()).float().reshape(-1, 3)
uv = torch.stack([(torch.arange(count).repeat_interleave(3) + 0.5) / count, torch.full((3 * count,), 0.5)], 1)
camera = torch.from_numpy(result.intrinsics).float()
drawer = MeshInCamera(corners, torch.arange(3 * count).view(-1, 3), uv, colors, (128, 128), camera, 30_000)
turns = SO3().to_value(torch.tensor([[0.0, angle, 0.0] for angle in (0.0, 0.5, -0.5)]))
rotation = torch.from_numpy(result.rotation).float() @ turns
drawn = drawer(rotation=rotation, translation=torch.from_numpy(result.translation).float().expand(3, 3)).image

photo = torch.from_numpy(view.image).movedim(-1, 0)[None]
columns = {"photo": photo, "mesh": drawn[:1], "from the left": drawn[1:2], "from the right": drawn[2:]}
picture_table(columns).savefig(folder / "mesh_of_an_object.png")
print(folder / "mesh_of_an_object.png")
