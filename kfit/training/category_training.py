"""Trains the classifier of categories: ``python -m kfit.training.category_training FILE``.

The bundled weights are those of the defaults, which take about ten minutes on one core.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from jsonargparse import auto_cli
from rich.progress import track
from safetensors.torch import save_file
from torch import Tensor

from kfit.features.category_classifier import NAMES, NONE, grouped, object_square
from kfit.features.imagenet_classifier import ImageNetClassifier
from kfit.geometry import CATEGORIES
from kfit.training.category_scenes import Scene, empty_scene, object_scene, other_scene

# Features hardly vary where their deviation is below this.
LEAST_DEVIATION = 0.05


def train(out: Path, num_objects: int = 250, penalty: float = 0.3, seed: int = 0) -> None:
    """Train the classifier and write its weights.

    With features f standardised over the training set, the mean cross-entropy plus penalty · Σ w² is minimised by
    L-BFGS over w, b and log t.

    Args:
        out: A .safetensors file.
        num_objects: Objects of each category; of other things and of empty boxes there are as many each.
        penalty: Weight of the squared corrections of ImageNet's classes.
        seed: Determines the random numbers.
    """
    network, rng = ImageNetClassifier(), np.random.default_rng(seed)
    rows, targets = [], []
    with torch.no_grad():
        for name, scene in track(scenes(num_objects, rng), "Objects", total=(len(NAMES) + 1) * num_objects):
            rows.append(network(crop(scene, rng)[None])[0])
            targets.append(NAMES.index(name))
        features = torch.cat(rows)
        prior = grouped(features @ network.class_weight.T + network.class_bias)
    weight, bias, trust = solve(features, prior, torch.tensor(targets), penalty)
    save_file({"weight": weight, "bias": bias, "trust": trust}, out)


def scenes(num_objects: int, rng: np.random.Generator) -> Iterator[tuple[str, Scene]]:
    """Yield names of `NAMES` and pictures."""
    for number in range(num_objects):
        for category in CATEGORIES:
            yield category, object_scene(category, number, rng)
        yield NONE, other_scene(rng)
        yield NONE, empty_scene(rng)


def crop(scene: Scene, rng: np.random.Generator) -> Tensor:
    """Return the square (3, 224, 224) around an inexact box, with a margin of 8 to 25 % on each side."""
    sides = scene.box[2:] - scene.box[:2]
    box = scene.box + rng.normal(0, 0.05, 4) * np.tile(sides, 2)
    return object_square((scene.image / 255).astype(np.float32), box, rng.uniform(0.08, 0.25))


def solve(features: Tensor, prior: Tensor, targets: Tensor, penalty: float) -> tuple[Tensor, Tensor, Tensor]:
    """Return weight (7, 1280), bias (7,) and trust () for features (N, 1280), not standardised, and prior (N, 7)."""
    mean, deviation = features.mean(0), features.std(0) + LEAST_DEVIATION
    standard = (features - mean) / deviation
    weight = torch.zeros(len(NAMES), features.shape[1], requires_grad=True)
    bias, log_trust = torch.zeros(len(NAMES), requires_grad=True), torch.zeros((), requires_grad=True)
    optimizer = torch.optim.LBFGS([weight, bias, log_trust], max_iter=200, line_search_fn="strong_wolfe")

    def loss() -> Tensor:
        optimizer.zero_grad()
        logits = log_trust.exp() * prior + standard @ weight.T + bias
        value = F.cross_entropy(logits, targets) + penalty * weight.square().sum()
        value.backward()
        return value

    optimizer.step(loss)
    with torch.no_grad():
        plain = weight / deviation
        return plain, bias - plain @ mean, log_trust.exp()


if __name__ == "__main__":
    auto_cli(train)
