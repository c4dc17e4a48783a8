"""Register two photos of the same thing: a fit whose generator draws the first photo, warped and lit anew.

    python examples/register_photos.py [FOLDER]

Writes FOLDER/register_photos.png: both photos, the first as fitted to the second, and how they differ before and after.
FOLDER is kfit_out unless told.
"""

import sys
from pathlib import Path

import torch
import torch.nn.functional as F
from kornia.geometry.linalg import transform_points
from skimage import data

from kfit import FitPipeline
from kfit.callbacks import Pruning
from kfit.core import Observation
from kfit.energies import L2
from kfit.generators import Template
from kfit.initializers import Constant, Previous, Uniform
from kfit.optimizers import LevenbergMarquardt
from kfit.reports.picture_table import picture_table

# The second photo is made here, so that the truth is known: a homography, another brightness, noise.
photo = torch.from_numpy(data.coffee()).permute(2, 0, 1)[None, :, :, 100:500].float() / 255
photo = F.interpolate(photo, (192, 192), mode="area")[0]
truth = torch.tensor([[[0.10, -0.06], [-0.02, -0.12], [-0.08, 0.05], [0.06, 0.14]]])
maker = Template(photo, fill=0.4, light=True, oversampling=4)
noise = 0.02 * torch.randn(photo.shape, generator=torch.Generator().manual_seed(0))
second = maker(corners=truth, gain=torch.tensor([0.8]), bias=torch.tensor([0.1])).image[0] + noise

# Coarse to fine: similarities from 32 starts at an eighth of the size, then homographies up to the whole.
starts = [Uniform("roll", -0.3, 0.3), Uniform("shift", -0.2, 0.2), Constant({"scale": 1.0, "gain": 1.0, "bias": 0.0})]
for shrink in (8, 4, 2, 1):
    coarsest = shrink == 8
    first, seen = (F.avg_pool2d(picture[None], shrink)[0] for picture in (photo, second))
    # A bilinear warp of so few pixels would blur, and draw the fit aside: it reads from a grid four times as fine.
    motion = "similarity" if coarsest else "homography"
    generator = Template(first, motion, light=True, oversampling=4)
    few = {"callbacks": [Pruning({0: 16, 4: 4})], "num_starts": 32 if coarsest else 1, "num_steps": 8}
    result = FitPipeline(generator, {"l2": L2()}, starts, LevenbergMarquardt(), **few)(Observation(seen[None]), seed=0)
    matrix = generator.matrix(**{k: value for k, value in result.values.items() if k not in ("gain", "bias")})
    starts = [Previous(result, on=["gain", "bias"]), Constant({"corners": generator.corners(matrix)[0].tolist()})]

frame = torch.tensor([[[0.0, 0.0], [191.0, 0.0], [191.0, 191.0], [0.0, 191.0]]])
apart = transform_points(matrix, frame) - transform_points(maker.matrix(corners=truth), frame)
gain, bias = float(result.values["gain"]), float(result.values["bias"])
print(f"corners off by {float(apart.norm(dim=2).mean()):.3f} pixels, gain {gain:.3f} of 0.8, bias {bias:.3f} of 0.1")

drawn = generator(**result.values).image[0]
columns = {"first": photo, "second": second, "fitted": drawn}
columns |= {f"second less {name}, × 2": 0.5 + 2 * (second - columns[name]) for name in ("first", "fitted")}
path = Path(sys.argv[1] if len(sys.argv) > 1 else "kfit_out") / "register_photos.png"
path.parent.mkdir(parents=True, exist_ok=True)
picture_table({name: picture[None] for name, picture in columns.items()}).savefig(path)
print(path)
