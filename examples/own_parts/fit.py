"""Write an energy of your own and name it in a recipe: coins are measured although a tag lies on each of them.

    python examples/own_parts/fit.py [FOLDER]

Writes FOLDER/own_parts.png: the coins, and what the fits take for the coin, by kfit's L1 and by trimmed_l1.py beside
this file, which leaves out the pixels that fit worst. The generator, ellipse.py, and an initializer, from_moments.py,
are of one's own too; recipe.yaml names them all. FOLDER is kfit_out unless told.
"""

import sys
from pathlib import Path

import numpy as np
import torch
from jsonargparse import ArgumentParser
from skimage import data
from skimage.transform import resize
from torch import Tensor

from kfit import FitPipeline
from kfit.core import Observation
from kfit.reports.picture_table import picture_table


def fit(picture: Tensor, *changes: str) -> tuple[Tensor, Tensor]:
    """Fit as the recipe says, but for what is changed in words, as one would on a command line."""
    parser = ArgumentParser()
    parser.add_class_arguments(FitPipeline, "fit")
    arguments = parser.parse_args([f"--fit={Path(__file__).with_name('recipe.yaml')}", *changes])
    pipeline: FitPipeline = parser.instantiate(arguments).fit
    values = pipeline(Observation(picture), seed=0).values
    return 32 * values["radii"].sort().values, pipeline.generator(**values).field("mask")


# Four coins of scikit-image's photo, one problem each, and the same with white tags on their rims.
corners = [(14, 6), (4, 296), (152, 176), (222, 14)]
coins = [resize(data.coins()[top : top + 72, left : left + 72], (64, 64)) for top, left in corners]
clean = torch.tensor(np.stack(coins)).float()[:, None].expand(-1, 3, -1, -1)
tagged = clean.clone()
tagged[:, :, 36:54, 38:64] = 1.0

truth, _ = fit(clean)
columns = {"seen": tagged}
for name, changes in {"L1": ["--fit.energies.image=kfit.energies.L1"], "TrimmedL1": []}.items():
    radii, mask = fit(tagged, *changes)
    error = float((radii - truth).abs().mean())
    print(f"{name}: radii off by {error:.2f} pixels from those of the coins without tags")
    columns[f"by {name}:\nradii off by {error:.1f} pixels"] = tagged * (0.3 + 0.7 * mask)

path = Path(sys.argv[1] if len(sys.argv) > 1 else "kfit_out") / "own_parts.png"
path.parent.mkdir(parents=True, exist_ok=True)
picture_table(columns).savefig(path)
print(path)
