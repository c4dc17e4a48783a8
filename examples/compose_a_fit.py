"""Compose a pose fit from its five parts, and fit laptops that are not in the training data.

    python examples/compose_a_fit.py [FOLDER]

Writes FOLDER/compose_a_fit.png: the observation, the best start, and the fit. FOLDER is kfit_out by default.
"""

import sys
from pathlib import Path

import kfit
from kfit.bench.held_out_views import held_out_views, rotation_errors
from kfit.callbacks import Pruning
from kfit.energies import SSIM, CodePrior, Perceptual, Silhouette
from kfit.features import EfficientNetLite0
from kfit.generators import SimilarityWarp
from kfit.initializers import Constant, EncoderPosterior, FromCamera, PosePosterior
from kfit.optimizers import Adam
from kfit.pose.defaults import RATES
from kfit.reports.picture_table import picture_table

model = kfit.load("laptop")
assert model.pose_head is not None
# Any of the parts can be swapped for another, or for one of your own.
pipeline = kfit.FitPipeline(
    generator=SimilarityWarp(model.generator),
    energies={
        "look": Perceptual(EfficientNetLite0()),
        "structure": SSIM(),
        "outline": Silhouette(),
        "prior": CodePrior(),
    },
    weights={"structure": 2.0, "outline": 5.0, "prior": 0.02},
    initializers=[
        PosePosterior(model.pose_head),
        EncoderPosterior(model.encoder),
        Constant({"shift": 0.0, "scale": 1.0}),
        FromCamera(),
    ],
    optimizer=Adam({**RATES, "focal": 0.0}, betas=(0.5, 0.999)),
    callbacks=[Pruning({4: 2})],
    num_starts=6,
    num_steps=24,
)

# Three procedural laptops of shapes and textures that were held out of training, fitted at once.
views = held_out_views(model, num_views=3)
errors, (result,) = rotation_errors(model, views, pipeline)
print(f"rotations are off by {', '.join(f'{error:.1f}°' for error in errors.tolist())}")

columns = {"seen": views.observation.image}
for step in (0, 4, 12):
    winners = {name: value[step, range(3), result.start] for name, value in result.history.values.items()}
    columns[f"step {step}"] = pipeline.generator(**winners).image
columns["fitted"] = pipeline.generator(**result.values).image
path = Path(sys.argv[1] if len(sys.argv) > 1 else "kfit_out") / "compose_a_fit.png"
path.parent.mkdir(parents=True, exist_ok=True)
picture_table(columns, [f"off by {error:.1f}°" for error in errors.tolist()]).savefig(path)
print(path)
