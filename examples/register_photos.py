"""Register two photos of the same thing in one call, whatever their light.

    python examples/register_photos.py [FOLDER]

Writes FOLDER/register_photos.png: both photos, the first as fitted to the second, and how they differ before and after.
FOLDER is kfit_out by default.
"""

import sys
from pathlib import Path

import torch
import torch.nn.functional as F
from kornia.geometry.linalg import transform_points
from skimage import data

import kfit
from kfit.generators import Template
from kfit.reports.picture_table import picture_table

# The second photo is made here, so that the truth is known: a homography, another brightness, noise.
photo = torch.from_numpy(data.coffee()).permute(2, 0, 1)[None, :, :, 100:500].float() / 255
photo = F.interpolate(photo, (192, 192), mode="area")[0]
truth = torch.tensor([[[0.10, -0.06], [-0.02, -0.12], [-0.08, 0.05], [0.06, 0.14]]])
maker = Template(photo, fill=0.4, light=True, oversampling=4)
noise = 0.02 * torch.randn(photo.shape, generator=torch.Generator().manual_seed(0))
second = maker(corners=truth, gain=torch.tensor([0.8]), bias=torch.tensor([0.1])).image[0] + noise

found = kfit.register(photo, second, "homography")
assert found.matrix is not None  # flows have none

frame = torch.tensor([[[0.0, 0.0], [191.0, 0.0], [191.0, 191.0], [0.0, 191.0]]])
apart = transform_points(found.matrix, frame) - transform_points(maker.matrix(corners=truth), frame)
error, gain, offset = float(apart.norm(dim=2).mean()), float(found.gain), float(found.offset)
print(f"corners off by {error:.3f} pixels, gain {gain:.3f} of 0.8, offset {offset:.3f} of 0.1")

columns = {"first": photo, "second": second, "fitted": found.warped[0]}
for name in ("first", "fitted"):
    known = found.weight[0] > 0 if name == "fitted" else True
    columns[f"second less {name}, × 2"] = 0.5 + 2 * (second - columns[name]) * known
path = Path(sys.argv[1] if len(sys.argv) > 1 else "kfit_out") / "register_photos.png"
path.parent.mkdir(parents=True, exist_ok=True)
picture_table({name: picture[None] for name, picture in columns.items()}).savefig(path)
print(path)
