"""Straighten a bent picture: a flow of control points, smoothed by its bending energy, in one call.

    python examples/bend_a_picture.py [FOLDER]

Writes FOLDER/bend_a_picture.png: the picture, the picture bent by a wave, and the picture bent by the fitted flow.
FOLDER is kfit_out by default.
"""

import sys
from pathlib import Path

import torch
import torch.nn.functional as F
from skimage import data

import kfit
from kfit.generators import Template
from kfit.reports.picture_table import picture_table

photo = torch.from_numpy(data.coins()).float()[None, None, :, :302] / 255
photo = F.interpolate(photo, (96, 96), mode="area")[0]
# A wave along each axis, some 3 pixels high, which is not of the kind that is fitted: twelve control points a side.
phase = torch.linspace(0, 6, 12)
wave = torch.stack([phase.sin()[:, None].expand(12, 12), phase.cos()[None].expand(12, 12)])[None]
bent = Template(photo, "flow", control=(12, 12), oversampling=4)(displacement=0.06 * wave)

found = kfit.register(photo, bent.image, "flow", fixed_mask=bent.weight, control=(9, 9))

truth = Template(photo, "flow", control=(12, 12)).places(displacement=0.06 * wave)
inside = (bent.field("weight")[0, 0] > 0.99) & (found.weight[0, 0] > 0.99)
still = torch.stack(torch.meshgrid(torch.arange(96.0), torch.arange(96.0), indexing="xy"), -1)
before = float((truth[0] - still).norm(dim=-1)[inside].mean())
after = float((truth[0] - still - found.displacement[0].movedim(0, -1)).norm(dim=-1)[inside].mean())
print(f"pixels off by {before:.2f} before, by {after:.2f} after")

grid = (torch.arange(96) % 12 == 0).float()
lines = torch.maximum(grid[:, None], grid[None]).expand(1, 1, 96, 96)
columns = {"picture": photo, "bent": bent.image[0], "bent by the fit": found.warped[0]}
columns |= {"a grid, bent so": 1 - found.warp(lines)[0], "differences, × 2": 0.5 + 2 * (bent.image - found.warped)[0]}
path = Path(sys.argv[1] if len(sys.argv) > 1 else "kfit_out") / "bend_a_picture.png"
path.parent.mkdir(parents=True, exist_ok=True)
picture_table({name: picture.expand(3, -1, -1)[None] for name, picture in columns.items()}).savefig(path)
print(path)
