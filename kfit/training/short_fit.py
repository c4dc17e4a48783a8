"""A short fit that evaluates a generator: poses of views of which nothing is known."""

from __future__ import annotations

import torch
from torch import Tensor

from kfit.callbacks import Pruning
from kfit.core import Encoder, Energy, Generator, Initializer, Observation, Prior, Schedule
from kfit.energies import SSIM, CodePrior, Silhouette
from kfit.fitting.pipeline import FitPipeline
from kfit.generators import fixed_camera
from kfit.geometry.pose import rotation_of
from kfit.initializers import EncoderPosterior, FromCamera, SphereGrid
from kfit.optimizers import Adam

# Raw units a step, as the released code fits (neural_object_fitting@7309348): half-turns for angles.
RATES = {"code": 0.3, "azimuth": 0.03, "elevation": 0.01}
STARTS, STEPS = 4, 16


def fitted_rotations(generator: Generator, encoder: Encoder, observation: Observation) -> Tensor:
    """Fit the rotations of views by the standard camera.

    Roll, shift and scale are known, and the distance if the views have intrinsics. 64 poses around the hemisphere of
    photos, each with the encoder's code, are drawn, and the best 4 are fitted in 16 steps of Adam with rates that decay
    to 1/12. The energies are SSIM and, with masks, silhouettes, whatever the generator was trained with, so that
    different trainings can be compared.

    Args:
        generator: generator with ``code``, ``azimuth`` and ``elevation``.
        encoder: picture → Gaussian over the code.
        observation: N views, with masks if the generator draws any, and intrinsics only if it has a ``focal``.

    Returns:
        (N, 3, 3) in the generator's y-up frame, NaN if every start failed.
    """
    # In test Lightning forbids gradients by inference mode, and networks copied under it could never have any.
    with torch.inference_mode(False), torch.no_grad():
        energies: dict[str, Energy | Prior] = {"ssim": SSIM(), "prior": CodePrior()}
        weights: dict[str, float | Schedule] = {"ssim": 2.0, "prior": 0.02}
        if observation.mask is not None:
            energies["silhouette"], weights["silhouette"] = Silhouette(), 5.0
        initializers: list[Initializer] = [SphereGrid(), EncoderPosterior(encoder)]
        rates = dict(RATES)
        if observation.intrinsics is None:
            generator = fixed_camera(generator)
        else:
            initializers.append(FromCamera())
            rates["focal"] = 0.0
        pipeline = FitPipeline(
            generator,
            energies,
            initializers,
            Adam(rates, (0.7, 0.95), 0.08 ** (1 / STEPS)),
            weights=weights,
            callbacks=[Pruning({3: STARTS // 2})],
            num_starts=STARTS,
            num_steps=STEPS,
            num_candidates=16 * STARTS,
        )
        # Not in autocast's halves, which are half a degree wide.
        found = {name: value.double() for name, value in pipeline(observation, seed=0).values.items()}
        rotation: Tensor = rotation_of(found)
        return rotation
