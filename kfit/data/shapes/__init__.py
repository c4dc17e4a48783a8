"""Procedural objects of the six NOCS categories, with shape and texture families, some of which are held out."""

from __future__ import annotations

import importlib

import numpy as np

from kfit import geometry
from kfit.core.check import check_choice, check_count
from kfit.data.exposure import with_exposure
from kfit.data.light import Light
from kfit.data.mesh import Mesh

CATEGORIES = tuple(sorted(geometry.CATEGORIES, key=lambda name: geometry.CATEGORIES[name].nocs_id))
"""Names of the categories, in the order of NOCS's class ids 1 to 6."""


VERSION = 9
"""Incremented when a seed gives another object, so that cached views are rendered again."""


def build(category: str, seed: int, held_out: bool = False) -> tuple[Mesh, Light]:
    """Build an object and its light, the same for the same arguments on every machine.

    The object is in NOCS's frame: y up, centred at its box's centre, box diagonal 1, with baked exposure.

    Args:
        category: One of ``CATEGORIES``.
        seed: Number of the object, at least 0.
        held_out: Whether to draw from the held-out shape and texture families, instead of those of training.

    Raises:
        ValueError: If the category is unknown or the seed negative.

    Example:
        >>> from kfit.data import build
        >>> mug, light = build("mug", seed=0)
        >>> mug.vertices.shape[1], bool(abs((mug.bounds[1] - mug.bounds[0]) ** 2).sum().round(3) == 1)
        (3, True)
    """
    check_choice("category", category, CATEGORIES)
    check_count("seed", seed, 0)
    check_choice("held_out", held_out, (False, True))
    module = importlib.import_module(f"kfit.data.shapes.{category}")
    rng = np.random.default_rng([seed, CATEGORIES.index(category), int(held_out)])
    mesh = module.build(rng, held_out).normalised()
    return with_exposure(mesh), Light.random(rng)
