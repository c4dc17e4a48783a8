"""Compose a fit by hand: explain a drawing of a laptop with the paper's schedule and an energy of your choice."""

import math
import sys

import torch
from skimage.io import imsave

import kfit
from kfit.callbacks import Progress, Pruning
from kfit.core import Observation
from kfit.energies import SSIM, CodePrior, Silhouette
from kfit.generators import SimilarityWarp
from kfit.initializers import Constant, EncoderPosterior, SphereGrid
from kfit.models.accuracy import unseen_views
from kfit.models.usual_fit import RATES
from kfit.optimizers import Adam

model = kfit.load("laptop")
generator = SimilarityWarp(model.generator)
pipeline = kfit.FitPipeline(
    generator,
    energies={"ssim": SSIM(), "silhouette": Silhouette(), "prior": CodePrior()},
    initializers=[
        SphereGrid(elevation_deg=(0, 60)),
        EncoderPosterior(model.encoder),
        Constant({"roll": 0.0, "shift": 0.0, "scale": 1.0}),
    ],
    optimizer=Adam(RATES, betas=(0.5, 0.999)),
    weights={"prior": 0.02},
    callbacks=[Progress(), Pruning({8: 6, 20: 2})],
    num_starts=24,
    num_steps=40,
)

views = unseen_views(model, num_views=1, seed=1)
result = pipeline(views.observation, seed=0)

drawn = generator(**result.values)
angles = {name: math.degrees(float(result.values[name])) for name in ("azimuth", "elevation", "roll")}
print(", ".join(f"{name} {angle:.0f}°" for name, angle in angles.items()), f"energy {float(result.energy):.3f}")
print(f"{result.num_evaluations} pictures drawn; the winner was start {int(result.start)}")

seen: Observation = views.observation
panels = torch.cat([seen.image[0], drawn.image[0].detach()], 2).clamp(0, 1)
path = sys.argv[1] if len(sys.argv) > 1 else "compose_a_fit.png"
imsave(path, (255 * panels.permute(1, 2, 0)).byte().numpy(), check_contrast=False)
print(f"seen and fitted side by side: {path}")
