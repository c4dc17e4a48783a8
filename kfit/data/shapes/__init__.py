"""Procedural objects of categories, with shape and texture families, some of which are held out."""

from __future__ import annotations

import hashlib
import importlib
import sys
import zlib
from pathlib import Path
from types import ModuleType

import numpy as np

from kfit import geometry
from kfit.core.arguments import check_arguments
from kfit.core.check import check_choice
from kfit.data.exposure import with_exposure
from kfit.data.light import Light
from kfit.data.mesh import Mesh

CATEGORIES = tuple(geometry.CATEGORIES)
"""Names of kfit's own categories, in the order of NOCS's class ids 1 to 6."""


VERSION = 13
"""Incremented when a seed gives another object, so that cached views are rendered again."""


def build(category: str | geometry.Category, seed: int, held_out: bool = False) -> tuple[Mesh, Light]:
    """Build an object and its light, the same for the same arguments on every machine.

    The object is in its category's frame: y up, centred at its box's centre, box diagonal 1, with baked exposure.

    Args:
        category: One of ``CATEGORIES``, or a custom category whose ``shapes`` name a module, which is imported.
        seed: Number of the object, at least 0.
        held_out: Whether to draw from the held-out shape and texture families, instead of those of training.

    Raises:
        ValueError: If the category is unknown, no module draws it, or the seed is negative.

    Example:
        >>> from kfit.data import build
        >>> mug, light = build("mug", seed=0)
        >>> mug.vertices.shape[1], bool(abs((mug.bounds[1] - mug.bounds[0]) ** 2).sum().round(3) == 1)
        (3, True)
    """
    if not isinstance(category, geometry.Category):
        check_choice("category", category, CATEGORIES)
        category = geometry.CATEGORIES[category]
    check_arguments(build, locals(), seed=(0,))
    module, own = _module(category), category.name not in CATEGORIES
    kind = zlib.crc32(category.name.encode()) if own else CATEGORIES.index(category.name)
    rng = np.random.default_rng([seed, kind, int(held_out)])
    mesh = module.build(rng, held_out).normalised()
    return with_exposure(mesh, two_sided=None) if own else with_exposure(mesh), Light.random(rng)


def version_of(category: geometry.Category) -> int | str:
    """Return a version that changes whenever a seed gives another object; of custom modules, a digest of the source."""
    module = _module(category)
    if module.__name__.startswith(_OWN):
        return VERSION
    file = getattr(module, "__file__", None)
    return hashlib.sha256(Path(file).read_bytes()).hexdigest()[:16] if file else "unknown"


_OWN = f"{__name__}."


def _module(category: geometry.Category) -> ModuleType:
    """Return the module that builds a category's objects: kfit's, or an imported one; a file must not cause imports."""
    path = category.shapes
    if path is None:
        raise ValueError(f"nothing draws objects of the category {category.name}; give mesh files instead")
    own = path.startswith(_OWN) and path.removeprefix(_OWN) in CATEGORIES
    module = importlib.import_module(path) if own else sys.modules.get(path)
    if module is None:
        raise ValueError(f"the category {category.name} is drawn by {path}, which is not imported: --import {path}")
    if not callable(getattr(module, "build", None)):
        raise ValueError(f"the module {path}, which draws the category {category.name}, has no function build")
    return module
