"""Views that a calibration rests on: seen in all ways, partly hidden, badly masked, and of other things."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from kfit.bench.held_out_views import Corruption, HeldOutViews, held_out_views, views_of
from kfit.bench.scans import mesh_objects
from kfit.bench.view_cameras import ViewsOf
from kfit.data import build
from kfit.data.mesh_places import MeshFile
from kfit.data.rasterizer import View
from kfit.geometry import CATEGORIES
from kfit.pose.category_model import CategoryModel
from kfit.training.random_corruption import occluded as hide_square


@dataclass(frozen=True)
class ViewSet:
    """Views of one kind.

    Attributes:
        name: name of the kind.
        share: share of all views.
        views_of: how the objects are seen; see `kfit.bench.view_cameras.sample_view`.
        corruption: corruption applied to the photo before the object is cut out of it.
        foreign: whether they show other things than the category's, so that no answer is right.
    """

    name: str
    share: float
    views_of: ViewsOf
    corruption: Corruption | None = None
    foreign: bool = False


def occluded(view: View, rng: np.random.Generator) -> View:
    """Hide 10 to 40 % of the mask behind something whose border is straight; the mask leaves it out."""
    rows, columns = np.nonzero(view.mask > 0.5)
    angle = rng.uniform(0, 2 * np.pi)
    along = np.cos(angle) * columns + np.sin(angle) * rows
    return _cut(view, angle, float(np.quantile(along, rng.uniform(0.6, 0.9))))


def covered(view: View, rng: np.random.Generator, share: float) -> View:
    """Hide a share of the mask behind a square around a random pixel of it; the mask leaves it out."""
    image, mask = torch.from_numpy(view.image).movedim(2, 0)[None], torch.from_numpy(view.mask)[None, None]
    numbers = torch.Generator().manual_seed(int(rng.integers(2**62)))
    shown, kept = hide_square(image, mask, share, numbers)
    return replace(view, image=shown[0].movedim(0, 2).numpy(), mask=kept[0, 0].numpy())


def cut(view: View, rng: np.random.Generator) -> View:
    """Cut 10 to 35 % of the object off at a side of the picture."""
    rows, columns = np.nonzero(view.mask > 0.5)
    angle = rng.integers(4) * np.pi / 2
    along = np.cos(angle) * columns + np.sin(angle) * rows
    low, high = float(along.min()), float(along.max())
    return _cut(view, angle, high - rng.uniform(0.1, 0.35) * (high - low))


def badly_masked(view: View, rng: np.random.Generator) -> View:
    """Add a piece of the surroundings, in a colour of their own, to the mask, or grow or shrink it by 3 to 8 %."""
    mask = (view.mask > 0.5).astype(np.uint8)
    size = max(1, round(rng.uniform(0.03, 0.08) * float(np.sqrt(mask.sum()))))
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * size + 1, 2 * size + 1))
    kind = rng.integers(3)
    if kind == 0:
        found = cv2.erode(mask, kernel)
    elif kind == 1:
        found = cv2.dilate(mask, kernel)
    else:
        rows, columns = np.nonzero(mask)
        place = rng.integers(len(rows))
        found = mask.copy()
        radius = round(rng.uniform(0.12, 0.3) * float(np.sqrt(mask.sum())))
        cv2.circle(found, (int(columns[place]), int(rows[place])), radius, 1, -1)
    if not found.any():
        found = mask
    ground = rng.uniform(0.1, 0.9, 3).astype(np.float32)
    alpha = view.mask[..., None]
    # The photo is on white; what is added to the mask shows the surroundings.
    photo = np.clip(view.image - (1 - alpha) * (1 - ground), 0, 1)
    return replace(view, image=photo, mask=found.astype(np.float32))


SETS = (
    ViewSet("upright", 0.2, "upright"),
    ViewSet("table", 0.25, "table"),
    ViewSet("any", 0.2, "any"),
    ViewSet("occluded", 0.08, "table", occluded),
    ViewSet("cut", 0.06, "table", cut),
    ViewSet("badly masked", 0.08, "table", badly_masked),
    ViewSet("foreign", 0.13, "table", foreign=True),
)
"""What photos show, by kind, with shares that sum to 1."""


def calibration_views(
    model: CategoryModel,
    num_views: int,
    seed: int,
    on_view: Callable[[int], None] = lambda done: None,
    meshes: Sequence[MeshFile] = (),
) -> Iterator[tuple[ViewSet, HeldOutViews]]:
    """Draw each set's share of ``num_views`` views, at least one of each.

    Objects are of held-out families, or the meshes where some are given; foreign ones are of kfit's other categories.
    """
    done = 0
    for number, chosen in enumerate(SETS):
        count = max(1, round(chosen.share * num_views))

        def shown(drawn: int, before: int = done) -> None:
            on_view(before + drawn)

        if chosen.foreign:
            others = [name for name in CATEGORIES if name != model.card.category]
            objects = (
                build(others[i % len(others)], 1_000_000 + 1_000 * seed + i, held_out=True) for i in range(count)
            )
            views = views_of(model, objects, seed + 100 * number, on_view=shown, kind=chosen.views_of)
        elif meshes:
            own = mesh_objects(meshes, count, seed + 100 * number)
            views = views_of(
                model, own, seed + 100 * number, on_view=shown, kind=chosen.views_of, corruption=chosen.corruption
            )
        else:
            views = held_out_views(
                model, count, seed + 100 * number, on_view=shown, kind=chosen.views_of, corruption=chosen.corruption
            )
        done += count
        yield chosen, views


def _cut(view: View, angle: float, limit: float) -> View:
    height, width = view.mask.shape
    along = np.cos(angle) * np.arange(width) + np.sin(angle) * np.arange(height)[:, None]
    kept: NDArray[np.float32] = (along <= limit).astype(np.float32)
    return replace(view, image=(view.image - 1) * kept[..., None] + 1, mask=view.mask * kept, depth=view.depth * kept)
