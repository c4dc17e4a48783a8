"""How well a model finds the poses of objects that it has never seen."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from kfit.core import FitResult, Observation
from kfit.core.check import check_count
from kfit.data import Light, Mesh, build, pose_view
from kfit.data.rasterizer import View, standard_intrinsics
from kfit.fitting.pipeline import FitPipeline
from kfit.geometry import Crop, observed, rotation_error, rotation_from_angles
from kfit.pose.category_model import CategoryModel
from kfit.pose.observed_object import ObservedObject
from kfit.pose.result import PoseResult

# A mug "shows its handle" when the handle covers this share of the mask; else NOCS lets it turn freely.
HANDLE_SHARE = 0.02
# A rotation error under which an answer is right where it is asked whether kfit knows that it is.
RIGHT_DEG = 20.0
FIELDS = ("image", "mask", "depth", "intrinsics")


@dataclass(frozen=True)
class HeldOutViews:
    """Photos of unseen objects, cut out as `CategoryModel.pose` cuts a photo, with their true poses.

    Attributes:
        observation: N problems, with depth and intrinsics.
        rotation: (N, 3, 3) in the generator's y-up frame.
        visible: (N,) False where a mug's handle is hidden.
        distance: (N,) of the objects' centres on the photo's axis, in metres.
        crops: N squares that were cut out.
        intrinsics: (3, 3) of the photos.
        photos: N pictures (H, W, 3) in [0, 1] on white.
        masks: N of them, (H, W) in [0, 1].
    """

    observation: Observation
    rotation: Tensor
    visible: Tensor
    distance: Tensor
    crops: list[Crop]
    intrinsics: Tensor
    photos: list[NDArray[np.float32]]
    masks: list[NDArray[np.float32]]


def held_out_views(
    model: CategoryModel,
    num_views: int,
    seed: int = 0,
    photo_size: int = 256,
    training: bool = False,
    on_view: Callable[[int], None] = lambda done: None,
) -> HeldOutViews:
    """Draw one view each of ``num_views`` objects of seeds and of shape and texture families held out of training.

    They are drawn by `views_of`. For comparison, ``training`` shows objects of training instead;
    ``on_view`` is told how many are drawn.
    """
    check_count("held_out_views: num_views", num_views)
    check_count("held_out_views: seed", seed, 0)
    check_count("held_out_views: photo_size", photo_size, 8, 4096)
    # Far from the seeds that training and its validation count up from 0.
    first = 0 if training else 1_000_000 + 1_000 * seed
    objects = (build(model.card.category, first + number, held_out=not training) for number in range(num_views))
    return views_of(model, objects, seed, photo_size, on_view)


def views_of(
    model: CategoryModel,
    objects: Iterable[tuple[Mesh, Light]],
    seed: int = 0,
    photo_size: int = 256,
    on_view: Callable[[int], None] = lambda done: None,
) -> HeldOutViews:
    """Draw one view each of normalised objects in NOCS's frame.

    Azimuths over the full circle, elevations over the card's range, the training camera; each is drawn as a photo of
    ``photo_size`` pixels and cut out by its mask, so that scale and shift are unknown as they are in photos. Objects
    are up to a fifth larger or smaller than the category's mean.
    """
    card = model.card
    camera = torch.from_numpy(standard_intrinsics(photo_size, card.distance, card.unit_fraction)).double()
    pieces, crops, rotations, visible, diagonals, photos, masks = [], [], [], [], [], [], []
    for number, (mesh, light) in enumerate(objects):
        rng = np.random.default_rng([seed, number])
        azimuth, elevation = rng.uniform(-math.pi, math.pi), math.radians(rng.uniform(*card.elevation_deg))
        view = pose_view(mesh, elevation, azimuth, light, photo_size, card.distance, card.unit_fraction)
        crop, diagonal = Crop.around(view.mask), card.mean_diagonal * 1.2 ** rng.uniform(-1, 1)
        depth = np.where(view.mask > 0, diagonal * view.depth, 0.0)
        pieces.append(observed(crop, _unblended(view), view.mask, depth, camera))
        crops.append(crop)
        diagonals.append(diagonal)
        rotations.append(rotation_from_angles(*torch.tensor([azimuth, elevation, 0.0], dtype=torch.float64)))
        visible.append(card.category != "mug" or handle_share(view, mesh.extents) >= HANDLE_SHARE)
        photos.append(view.image)
        masks.append(view.mask)
        on_view(number + 1)
    fields = {name: torch.cat([piece.field(name) for piece in pieces]) for name in FIELDS}
    seen = Observation(**fields, keys=tuple(range(len(pieces))))
    distance = card.distance * torch.tensor(diagonals)
    shown = torch.tensor(visible)
    return HeldOutViews(seen, torch.stack(rotations), shown, distance, crops, camera, photos, masks)


def handle_share(view: View, extents: NDArray[np.float32]) -> float:
    """Share of a mug's mask that its handle covers: the points outside the body's cylinder about the y axis.

    The body is round, so its radius is half the box's z side, and it touches the box's −x side.
    """
    radius = extents[2] / 2
    x, z = view.coords[..., 0] + extents[0] / 2 - radius, view.coords[..., 2]
    handle = (np.hypot(x, z) > 1.02 * radius) & (x > 0)
    return float((view.mask * handle).sum() / view.mask.sum())


def rotation_errors(
    model: CategoryModel,
    views: HeldOutViews,
    pipeline: FitPipeline | None = None,
    batch_size: int = 10,
    on_batch: Callable[[int], None] = lambda done: None,
) -> tuple[Tensor, list[FitResult]]:
    """Fit all views and compare: errors (N,) in degrees as NOCS judges them, NaN where a fit failed.

    Symmetric classes, and mugs whose handle is hidden, are judged by their axis.

    Args:
        model: what is measured.
        views: with their true poses.
        pipeline: the model's own unless given.
        batch_size: problems a fit; memory grows with it, answers do not change.
        on_batch: told how many views are done.
    """
    pipeline = pipeline or model.pipeline()
    errors, results = [], []
    seen, symmetry = views.observation, model.card.known.symmetry
    for first in range(0, seen.num_problems, batch_size):
        rows = slice(first, first + batch_size)
        fields = {name: seen.field(name)[rows] for name in FIELDS}
        piece = Observation(**fields, keys=seen.keys[rows])
        result = pipeline(piece, seed=0)
        angles = (result.values[name].double() for name in ("azimuth", "elevation", "roll"))
        found = rotation_from_angles(*angles)
        full, by_axis = (rotation_error(found, views.rotation[rows], how) for how in (symmetry, "y"))
        errors.append(torch.where(views.visible[rows], full, by_axis).rad2deg())
        results.append(result)
        on_batch(min(first + batch_size, seen.num_problems))
    return torch.cat(errors), results


def translation_errors(model: CategoryModel, views: HeldOutViews, results: list[FitResult]) -> Tensor:
    """Distances in metres (N,) between where the objects are and where the fits of `rotation_errors` have them."""
    errors: list[Tensor] = []
    for fit in (result.of(number) for result in results for number in range(len(result.energy))):
        truth = views.distance[len(errors)] * torch.tensor([0.0, 0.0, 1.0])
        _, found, _ = model.placed(fit.values, views.crops[len(errors)], views.intrinsics)
        errors.append((found[0] - truth).norm())
    return torch.stack(errors)


def answer_to(model: CategoryModel, views: HeldOutViews, results: list[FitResult], number: int) -> PoseResult:
    """What `CategoryModel.pose` would have answered to one view that `rotation_errors` fitted without failing."""
    fit = [result.of(row) for result in results for row in range(len(result.energy))][number]
    fields = {name: views.observation.field(name)[number : number + 1] for name in FIELDS}
    seen = Observation(**fields, keys=(number,))
    where = (views.photos[number], views.masks[number], views.crops[number], views.intrinsics)
    return model.answer(fit, ObservedObject(seen, *where, "given", ()))


def called_ambiguous(model: CategoryModel, views: HeldOutViews, results: list[FitResult]) -> Tensor:
    """Whether each view's answer is said to be ambiguous, (N,): what `rotation_errors` found, judged as `pose` does."""
    said: list[bool] = []
    upright, pose_log_probabilities = (
        torch.eye(3, dtype=torch.float64),
        model.pose_log_probabilities(views.observation.image),
    )
    for fit in (result.of(number) for result in results for number in range(len(result.energy))):
        seen = None if pose_log_probabilities is None else pose_log_probabilities[len(said) : len(said) + 1]
        # Where no start was left, nothing is sure.
        said.append(not len(fit.all_energy) or model.hypotheses(fit, upright, seen)[1] is not None)
    return torch.tensor(said)


def _unblended(view: View) -> NDArray[np.float32]:
    """The colours without the white ground that blends into their edges; the crop blends anew."""
    colour = (view.image - (1 - view.mask[..., None])) / np.maximum(view.mask[..., None], 1e-3)
    clipped: NDArray[np.float32] = np.clip(colour, 0, 1).astype(np.float32)
    return clipped
