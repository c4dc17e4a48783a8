"""How the cost of a fit grows: with objects, starts, steps, code and picture size, and with processes."""

from __future__ import annotations

import multiprocessing
import time
from collections.abc import Mapping, Sequence
from typing import Any

import torch

from kfit.bench.fit_cost import Cost, timed
from kfit.bench.held_out_views import held_out_views
from kfit.core import Energy, Observation, Prior
from kfit.energies import CodePrior
from kfit.fitting.pipeline import FitPipeline
from kfit.generators import RadianceField, SimilarityWarp, fixed_camera
from kfit.initializers import Constant, SphereGrid
from kfit.models.load import load
from kfit.optimizers import Adam
from kfit.pose.category_model import CategoryModel
from kfit.pose.defaults import RATES, default_energies

# What is varied, and the rest of it meanwhile.
AXES: dict[str, Sequence[int]] = {
    "objects": (1, 2, 4, 8, 16),
    "starts": (1, 2, 4, 8, 16),
    "steps": (4, 8, 16, 32),
    "code size": (4, 16, 64, 128),
    "picture size": (32, 64, 96, 128),
}
DEFAULTS = {"objects": 2, "starts": 4, "steps": 8, "code size": 16, "picture size": 64}


def resized(model: CategoryModel, code_dim: int, image_size: int) -> RadianceField:
    """The model's volume-rendered generator with a code and pictures of other sizes, its weights as far as they go.

    Raises:
        ValueError: for a model with another generator.
    """
    described = model.card.networks["generator"]
    if not isinstance(model.generator, RadianceField):
        raise ValueError(f"scaling is measured with a RadianceField, got {described['class_path']}")
    sized = {**described.get("init_args", {}), "code_dim": code_dim, "image_size": image_size}
    made, trained = RadianceField(**sized), model.generator.state_dict()
    own = made.state_dict()
    for name, tensor in own.items():
        weight = trained[name]
        if weight.shape != tensor.shape:  # further numbers of a code have no effect
            both = min(weight.shape[-1], tensor.shape[-1])
            tensor.zero_()[..., :both] = weight[..., :both]
        else:
            tensor.copy_(weight)
    made.load_state_dict(own)
    made.thickness = model.generator.thickness
    return made.eval()


def cost_of(model: CategoryModel, sizes: Mapping[str, int]) -> Cost:
    """What one fit costs, once it is warm.

    Args:
        model: model with a `RadianceField`.
        sizes: by the names of `AXES`.
    """
    side = sizes["picture size"]
    observation = held_out_views(model, sizes["objects"]).observation
    pictures, masks = (
        torch.nn.functional.interpolate(observation.field(name), (side, side), mode="area")
        for name in ("image", "mask")
    )
    parts: dict[str, Energy | Prior] = {name: energy for name, (energy, _) in default_energies().items()}
    code = torch.zeros(sizes["code size"])
    pipeline = FitPipeline(
        SimilarityWarp(fixed_camera(resized(model, len(code), side))),
        {**parts, "prior": CodePrior()},
        [SphereGrid(elevation_deg=(0, 60)), Constant({"code": code.tolist(), "roll": 0.0, "shift": 0.0, "scale": 1.0})],
        Adam(RATES),
        num_starts=sizes["starts"],
        num_steps=sizes["steps"],
    )
    problems = Observation(pictures, masks, keys=tuple(range(len(pictures))))
    return min((timed(pipeline, problems)[1] for _ in range(2)), key=lambda cost: cost.seconds)


def rate_of_processes(category: str, count: int, fits: int) -> float:
    """Fits a second of so many processes at once, each of one thread, after each has fitted once."""
    context = multiprocessing.get_context("spawn")
    barrier, done = context.Barrier(count), context.Queue()
    workers = [context.Process(target=_work, args=(category, number, fits, barrier, done)) for number in range(count)]
    for worker in workers:
        worker.start()
    spent = max(done.get() for _ in workers)
    for worker in workers:
        worker.join()
    return count * fits / float(spent)


def _work(category: str, number: int, fits: int, barrier: Any, done: Any) -> None:
    torch.set_num_threads(1)
    model = load(category)
    pipeline = model.pipeline()
    observation = held_out_views(model, 1, seed=number).observation
    pipeline(observation, seed=0)
    barrier.wait()
    begun = time.perf_counter()
    for _ in range(fits):
        pipeline(observation, seed=0)
    done.put(time.perf_counter() - begun)
