"""Latent inversion with an optimizer of torch: find the code with which a generator draws a photo.

    python examples/invert_a_generator.py [FOLDER]

A generator of laptops serves as the network: its codes and poses are fitted by torch.optim.AdamW with a cosine
schedule, eight starts at once, of which two survive. Writes FOLDER/invert_a_generator.png. FOLDER is kfit_out by
default.
"""

import sys
from pathlib import Path

import torch

import kfit
from kfit.callbacks import Pruning
from kfit.core import Observation
from kfit.data import build, pose_view
from kfit.energies import L1, SSIM, CodePrior
from kfit.fitting import Cosine
from kfit.generators import fixed_camera
from kfit.initializers import Constant
from kfit.optimizers import TorchOptimizer
from kfit.reports.picture_table import picture_table

RATES = {"code": 0.25, "azimuth": 0.02, "elevation": 0.01}  # in half-turns for angles
mesh, light = build("laptop", 1_006_003, held_out=True)
view = pose_view(mesh, 0.4, 0.3, light)
image = torch.from_numpy(view.image).movedim(-1, 0)[None]
generator = fixed_camera(kfit.load("laptop").generator)

pipeline = kfit.FitPipeline(
    generator,
    energies={"color": L1(), "structure": SSIM(), "prior": CodePrior()},
    weights={"color": 5.0, "prior": 0.001},
    initializers=[
        Constant({"code": 0.0}),
        Constant({"azimuth": 0.0, "elevation": 0.5}, sigma={"azimuth": 0.15, "elevation": 0.05}),
    ],
    optimizer=TorchOptimizer(torch.optim.AdamW, RATES, Cosine(1.0, 0.05), num_steps=40),
    callbacks=[Pruning({6: 4, 12: 2})],
    num_starts=8,
    num_steps=40,
    history=False,
)
result = pipeline(Observation(image), seed=0)

with torch.no_grad():
    drawn = generator(**result.values).image
    mean = generator(**result.values | {"code": 0 * result.values["code"]}).image
error = float((drawn - image).abs().mean())
print(f"mean difference {float((mean - image).abs().mean()):.3f} for the mean code, {error:.3f} for the code found")

path = Path(sys.argv[1] if len(sys.argv) > 1 else "kfit_out") / "invert_a_generator.png"
path.parent.mkdir(parents=True, exist_ok=True)
picture_table({"photo": image, "mean code": mean, "code found": drawn}).savefig(path)
print(path)
