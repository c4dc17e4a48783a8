"""How well a model finds the poses of objects that it has never seen."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from kfit.bench.view_cameras import ViewsOf, sample_view
from kfit.core import FitResult, Observation
from kfit.core.arguments import check_arguments
from kfit.data import Light, Mesh, build, render
from kfit.data.drawn_objects import SEED_STRIDE
from kfit.data.rasterizer import View
from kfit.fitting.pipeline import FitPipeline
from kfit.geometry import Crop, observed, rotation_error, rotation_from_angles
from kfit.pose.category_model import CategoryModel
from kfit.pose.confidence import evidence
from kfit.pose.hypotheses import fitted_rotations, hypotheses_of
from kfit.pose.observed_object import ObservedObject
from kfit.pose.placement import placement
from kfit.pose.result import PoseResult

# A mug "shows its handle" when the handle covers this share of the mask; else NOCS lets it turn freely.
HANDLE_SHARE = 0.02
# Changes a photo before the object is cut out of it.
Corruption = Callable[[View, np.random.Generator], View]
# A rotation error under which an answer is right where it is asked whether kfit knows that it is.
RIGHT_DEG = 20.0


@dataclass(frozen=True)
class HeldOutViews:
    """Photos of unseen objects, cut out as `CategoryModel.pose` cuts a photo, with their true poses.

    Attributes:
        observation: N problems, with depth and intrinsics.
        rotation: (N, 3, 3) relative to the ray to the object's centre, in the generator's y-up frame.
        visible: (N,) False where a mug's handle is hidden.
        translation: (N, 3) of the objects' centres in metres, in OpenCV axes.
        crops: N squares that were cut out.
        intrinsics: (N, 3, 3) of the photos.
        photos: N pictures (H, W, 3) in [0, 1] on white.
        masks: N of them, (H, W) in [0, 1].
    """

    observation: Observation
    rotation: Tensor
    visible: Tensor
    translation: Tensor
    crops: list[Crop]
    intrinsics: Tensor
    photos: list[NDArray[np.float32]]
    masks: list[NDArray[np.float32]]


def held_out_views(
    model: CategoryModel,
    num_views: int,
    seed: int = 0,
    photo_size: int = 256,
    training_seed: int | None = None,
    on_view: Callable[[int], None] = lambda done: None,
    kind: ViewsOf = "upright",
    corruption: Corruption | None = None,
) -> HeldOutViews:
    """Draw one view each of ``num_views`` objects of seeds and of shape and texture families held out of training.

    They are drawn by `views_of`. For comparison, ``training_seed`` shows objects of a training of that seed instead.
    """
    check_arguments(held_out_views, locals(), seed=(0,), photo_size=(8,), training_seed=(0,))
    # Far from the seeds that validation counts up from 0.
    first = 1_000_000 + 1_000 * seed if training_seed is None else training_seed * SEED_STRIDE
    objects = (build(model.card.known, first + number, training_seed is None) for number in range(num_views))
    return views_of(model, objects, seed, photo_size, on_view, kind, corruption)


def views_of(
    model: CategoryModel,
    objects: Iterable[tuple[Mesh, Light]],
    seed: int = 0,
    photo_size: int = 256,
    on_view: Callable[[int], None] = lambda done: None,
    kind: ViewsOf = "upright",
    corruption: Corruption | None = None,
) -> HeldOutViews:
    """Draw one view each of normalised objects in NOCS's frame.

    Each is drawn as a photo and cut out by its mask, so that scale and shift are unknown as they are in photos. Objects
    are up to a fifth larger or smaller than the category's mean.

    Args:
        model: whose category and crops they are.
        objects: meshes with their light.
        seed: chooses the poses.
        photo_size: side in pixels of an upright view.
        on_view: called with the number of views that are drawn.
        kind: how the objects are seen, see `kfit.bench.view_cameras.sample_view`.
        corruption: changes a photo before the object is cut out of it.
    """
    check_arguments(views_of, locals(), seed=(0,))
    card = model.card
    pieces, crops, cameras, visible, places, photos, masks = [], [], [], [], [], [], []
    for number, (mesh, light) in enumerate(objects):
        rng = np.random.default_rng([seed, number])
        diagonal = card.mean_diagonal * 1.2 ** rng.uniform(-1, 1)
        camera = sample_view(kind, card, diagonal, photo_size, rng)
        view = render(mesh, camera.world2cam, camera.intrinsics, camera.size, light)
        shown = handle_share(view, mesh.extents) if card.category == "mug" else 1.0
        if corruption is not None:
            view = corruption(view, rng)
        crop = Crop.around(view.mask, model.image_size)
        depth = np.where(view.mask > 0, diagonal * view.depth, 0.0)
        pieces.append(observed(crop, _unblended(view), view.mask, depth, torch.from_numpy(camera.intrinsics)))
        crops.append(crop)
        cameras.append(camera)
        places.append(diagonal * camera.translation)
        visible.append(shown >= HANDLE_SHARE)
        photos.append(view.image)
        masks.append(view.mask)
        on_view(number + 1)
    observation = replace(Observation.cat(pieces), keys=tuple(range(len(pieces))))
    rotation = torch.stack([camera.rotation for camera in cameras])
    intrinsics = torch.stack([torch.from_numpy(camera.intrinsics) for camera in cameras])
    return HeldOutViews(
        observation, rotation, torch.tensor(visible), torch.stack(places), crops, intrinsics, photos, masks
    )


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
    """Fit all views and compare: errors (N,) in degrees as in NOCS, NaN where a fit failed.

    Symmetric classes, and mugs whose handle is hidden, are measured by their axis.

    Args:
        model: model to measure.
        views: with their true poses.
        pipeline: by default the model's.
        batch_size: problems a fit; memory grows with it, answers do not change.
        on_batch: called with the number of finished views.
    """
    pipeline = pipeline or model.pipeline()
    errors, results = [], []
    observation, symmetry = views.observation, model.card.known.symmetry
    for first in range(0, observation.num_problems, batch_size):
        rows = slice(first, first + batch_size)
        result = pipeline(observation[rows], seed=0)
        angles = (result.values[name].double() for name in ("azimuth", "elevation", "roll"))
        found = rotation_from_angles(*angles)
        full, by_axis = (rotation_error(found, views.rotation[rows], how) for how in (symmetry, "y"))
        errors.append(torch.where(views.visible[rows], full, by_axis).rad2deg())
        results.append(result)
        on_batch(min(first + batch_size, observation.num_problems))
    return torch.cat(errors), results


def translation_errors(model: CategoryModel, views: HeldOutViews, results: list[FitResult]) -> Tensor:
    """Distances in metres (N,) between where the objects are and where the fits of `rotation_errors` have them."""
    errors: list[Tensor] = []
    for fit in (one for result in results for one in result):
        number = len(errors)
        _, found, _ = placement(fit.values, views.crops[number], views.intrinsics[number], model.card)
        errors.append((found[0] - views.translation[number]).norm())
    return torch.stack(errors)


def answer_to(model: CategoryModel, views: HeldOutViews, results: list[FitResult], number: int) -> PoseResult:
    """What `CategoryModel.pose` would have answered to one view that `rotation_errors` fitted without failing."""
    fit = [one for result in results for one in result][number]
    where = (views.photos[number], views.masks[number], views.crops[number], views.intrinsics[number])
    observation = views.observation[number]
    return model.answer(fit, ObservedObject(observation, *where, "given", ()), observation)


class Answer(NamedTuple):
    """What a fit of one view comes to.

    Attributes:
        number: number of the view.
        evidence: see `kfit.pose.confidence.evidence`.
        error_deg: error of the complete rotation, also of mugs whose handle is hidden, since a guess is not a
            certain answer.
        energy: energy of the winner.
    """

    number: int
    evidence: dict[str, float]
    error_deg: float
    energy: float


def answers(model: CategoryModel, views: HeldOutViews, results: list[FitResult]) -> Iterator[Answer]:
    """Answers to the views that `rotation_errors` fitted without failing."""
    upright, log_probabilities = torch.eye(3).double(), model.pose_log_probabilities(views.observation)
    fits = (one for result in results for one in result)
    for number, fit in enumerate(fits):
        if fit.start[0] < 0:
            continue
        head = None if log_probabilities is None else log_probabilities[number]
        hypotheses = hypotheses_of(fit, upright, model.card, model.pose_head, head)
        error = rotation_error(fitted_rotations(fit.values)[0], views.rotation[number], model.card.known.symmetry)
        yield Answer(
            number,
            evidence(hypotheses.alternatives, hypotheses.head_share),
            float(error.rad2deg()),
            float(fit.energy[0]),
        )


def called_ambiguous(model: CategoryModel, views: HeldOutViews, results: list[FitResult]) -> Tensor:
    """Whether each view's answer is reported as ambiguous, (N,): `rotation_errors`' fits, evaluated as `pose` does."""
    ambiguous: list[bool] = []
    upright, log_probabilities = torch.eye(3).double(), model.pose_log_probabilities(views.observation)
    for fit in (one for result in results for one in result):
        head = None if log_probabilities is None else log_probabilities[len(ambiguous)]
        # Where no start was left, the answer is ambiguous.
        ambiguous.append(
            not len(fit.all_energy)
            or hypotheses_of(fit, upright, model.card, model.pose_head, head).ambiguity is not None
        )
    return torch.tensor(ambiguous)


def _unblended(view: View) -> NDArray[np.float32]:
    """The colours without the white ground that blends into their edges; the crop blends anew."""
    colour = (view.image - (1 - view.mask[..., None])) / np.maximum(view.mask[..., None], 1e-3)
    clipped: NDArray[np.float32] = np.clip(colour, 0, 1).astype(np.float32)
    return clipped
