"""Invert photos to codes and poses, and redraw them: the same pose with another appearance, and other poses.

    python examples/edit_appearance.py [FOLDER]

Writes FOLDER/edit_appearance.png: a row for each object, with the observation, its fit, and new drawings from the
fit. FOLDER is kfit_out by default.
"""

import math
import sys
from pathlib import Path

import torch
from torch import Tensor

import kfit
from kfit.bench.held_out_views import views_of
from kfit.core import Rendering
from kfit.data import build
from kfit.reports.picture_table import picture_table

# Three procedural mugs of kinds that the model has never seen; each is inverted to its code and its pose.
model = kfit.load("mug")
mugs = [build("mug", number, held_out=True) for number in (1_007_000, 1_009_001, 1_004_002)]
observed = views_of(model, mugs, seed=4).observation
pipeline = model.pipeline()
found = pipeline(observed, seed=0).values


def draw(**changes: Tensor) -> Rendering:
    """The mugs as they were found, but for what is changed."""
    return pipeline.generator(**{**found, **changes})


def colour(drawn: Rendering) -> Tensor:
    """Mean chromaticity (3, 3) of what each picture shows: colour without brightness, which the pose changes."""
    mean = (drawn.image * drawn.field("mask")).sum((2, 3))
    return mean / mean.sum(1, keepdim=True)


fitted = draw()
swapped = draw(code=found["code"].roll(-1, 0))  # each mug takes the look of the one below it
columns = {
    "seen": observed.image,
    "fitted": fitted.image,
    "same pose,\nlook of the next": swapped.image,
    "same pose,\nhalfway to it": draw(code=(found["code"] + found["code"].roll(-1, 0)) / 2).image,
    "same look,\nturned by 90°": draw(azimuth=found["azimuth"] + math.pi / 2).image,
    "same look,\nfrom above": draw(elevation=torch.full((3,), math.radians(60))).image,
}

before, after = ((colour(one) - colour(fitted).roll(-1, 0)).norm(dim=1).mean() for one in (fitted, swapped))
print(f"mean colours differ from those of the next mug by {before:.3f}, with its code by {after:.3f}")
path = Path(sys.argv[1] if len(sys.argv) > 1 else "kfit_out") / "edit_appearance.png"
path.parent.mkdir(parents=True, exist_ok=True)
picture_table(columns).savefig(path)
print(path)
