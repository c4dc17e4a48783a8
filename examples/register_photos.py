"""Register two photos of the same thing: a fit whose generator draws the first photo, warped and relit."""

import sys

import torch
import torch.nn.functional as F
from kornia.geometry.linalg import transform_points
from skimage import data
from skimage.io import imsave

from kfit import FitPipeline
from kfit.callbacks import Pruning
from kfit.core import Observation
from kfit.energies import L2
from kfit.generators import Template
from kfit.generators.template import Motion
from kfit.initializers import Constant, Previous, Uniform
from kfit.optimizers import LevenbergMarquardt

# The second photo is made here, so that the truth is known: a homography, another brightness, noise.
photo = torch.from_numpy(data.coffee()).permute(2, 0, 1)[None, :, :, 100:500].float() / 255
photo = F.interpolate(photo, (192, 192), mode="area")[0]
truth = torch.tensor([[[0.10, -0.06], [-0.02, -0.12], [-0.08, 0.05], [0.06, 0.14]]])
maker = Template(photo, fill=0.4, light=True, oversampling=4)
values = {"corners": truth, "gain": torch.tensor([0.8]), "bias": torch.tensor([0.1])}
second = maker(**values).image[0] + 0.02 * torch.randn(photo.shape, generator=torch.Generator().manual_seed(0))

# Coarse to fine: similarities from 32 starts at an eighth of the size, then homographies up to the whole.
starts = [
    Uniform("roll", -0.3, 0.3),
    Uniform("shift", -0.2, 0.2),
    Constant({"scale": 1.0, "gain": 1.0, "bias": 0.0}),
]
for shrink in (8, 4, 2, 1):
    first, seen = (F.avg_pool2d(picture[None], shrink)[0] for picture in (photo, second))
    # Outside the first photo stands the second itself: what the first cannot explain does not count.
    # A bilinear warp of so few pixels would blur, and draw the fit aside: it reads from a grid four times as fine.
    motion: Motion = "similarity" if shrink == 8 else "homography"
    generator = Template(first, motion, fill=seen, light=True, oversampling=4)
    pipeline = FitPipeline(
        generator,
        {"l2": L2()},
        starts,
        LevenbergMarquardt(),
        callbacks=[Pruning({0: 16, 4: 4})],
        num_starts=32 if shrink == 8 else 1,
        num_steps=8,
    )
    result = pipeline(Observation(seen[None]), seed=0)
    found = {name: value for name, value in result.values.items() if name not in ("gain", "bias")}
    matrix = generator.matrix(**found)
    starts = [
        Previous(result, on=["gain", "bias"]),
        Constant({"corners": generator.corners(matrix)[0].tolist()}),
    ]

corners = torch.tensor([[[0.0, 0.0], [191.0, 0.0], [191.0, 191.0], [0.0, 191.0]]])
apart = transform_points(matrix, corners) - transform_points(maker.matrix(corners=truth), corners)
print(f"corners lie {float(apart.norm(dim=2).mean()):.3f} pixels from the truth")
print(f"gain {float(result.values['gain']):.3f} of 0.8, bias {float(result.values['bias']):.3f} of 0.1")

drawn = generator(**result.values).image[0]
panels = torch.cat([photo, second, drawn, 0.5 + 2 * (second - drawn)], 2).clamp(0, 1)
path = sys.argv[1] if len(sys.argv) > 1 else "register_photos.png"
imsave(path, (255 * panels.permute(1, 2, 0)).byte().numpy(), check_contrast=False)
print(f"first, second, first as fitted to the second, and their difference: {path}")
