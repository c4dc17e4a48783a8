"""Parts of one's own, each in a file beside this one, in Python and in a recipe: ellipses fitted to coins."""

import sys
from pathlib import Path

import numpy as np
import torch
from ellipse import Ellipse
from from_moments import FromMoments
from jsonargparse import ArgumentParser
from skimage import data
from skimage.io import imsave
from skimage.transform import resize
from trimmed_l1 import TrimmedL1

from kfit import FitPipeline
from kfit.core import Observation
from kfit.initializers import Constant
from kfit.optimizers import Adam

# Four coins of scikit-image's photo, one problem each.
corners = [(14, 6), (4, 296), (152, 176), (222, 14)]
coins = [resize(data.coins()[top : top + 72, left : left + 72], (64, 64)) for top, left in corners]
seen = Observation(torch.tensor(np.stack(coins)).float()[:, None].expand(-1, 3, -1, -1))

# In Python.
written = FitPipeline(
    Ellipse(),
    {"image": TrimmedL1(share=0.85)},
    [FromMoments(), Constant({"roll": 0.0, "greys": [0.7, 0.3]})],
    Adam({"middle": 0.02, "radii": 0.02, "roll": 0.02, "greys": 0.05}),
    num_starts=4,
    num_steps=60,
)

# In words: the same parts by their import paths.
parser = ArgumentParser()
parser.add_class_arguments(FitPipeline, "fit")
parser.add_argument("--seed", type=int, default=0)
recipe = Path(__file__).with_name("recipe.yaml")
said = parser.parse_args([f"--fit={recipe}"])
built = parser.instantiate(said).fit

result = built(seen, seed=said.seed)
assert torch.equal(result.energy, written(seen, seed=0).energy)
for number, (x, y) in enumerate(result.values["radii"].tolist()):
    print(f"coin {number}: radii {32 * x:.1f} and {32 * y:.1f} pixels, energy {float(result.energy[number]):.3f}")

drawn = built.generator(**result.values).image
rows = [torch.cat(list(pictures), 2) for pictures in (seen.image, drawn)]
path = sys.argv[1] if len(sys.argv) > 1 else "own_parts.png"
imsave(path, (255 * torch.cat(rows, 1).permute(1, 2, 0).clamp(0, 1)).byte().numpy(), check_contrast=False)
print(f"coins and ellipses: {path}")
