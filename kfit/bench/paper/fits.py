"""Poses of unseen objects by a trained variant, and how far they are from the truth."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import torch
from numpy.typing import NDArray
from torch import Tensor

from kfit import FitPipeline
from kfit.baselines import CoordinateRegressor, OrientationRegressor, pose_of_coordinates
from kfit.bench.held_out_views import HeldOutViews, rotation_errors, translation_errors
from kfit.callbacks import Pruning
from kfit.core import Energy, FitResult, Initializer
from kfit.energies import L1, L2, SSIM, CodePrior, Perceptual
from kfit.features import EfficientNetLite0
from kfit.generators import SimilarityWarp, fixed_camera
from kfit.geometry import CATEGORIES, PoseNetwork, from_opencv, rotation_error, rotation_from_angles
from kfit.geometry.pose import rotation_of
from kfit.initializers import Constant, EncoderPosterior, FromMask, PosePosterior, SphereGrid
from kfit.optimizers import Adam
from kfit.pose import CategoryModel
from kfit.pose.defaults import RATES
from kfit.pose.placement import placement

# Views of which more than the errors is kept, for pictures.
SHOWN = 5
# Rows that are fitted at once: the paper's generator needs some 30 MB a row.
ROWS = 160
# Energies of the picture by name, each with the weight of the code prior: 0.02 where a fit of the bundled models
# leaves 0.23 (perceptual), and as much in proportion where it leaves 0.033 (L1), 0.005 (L2) and 0.064 (SSIM).
ENERGIES: dict[str, tuple[Callable[[], Energy], float]] = {
    "perceptual": (lambda: Perceptual(EfficientNetLite0()), 0.02),
    "l1": (L1, 0.003),
    "l2": (L2, 0.0004),
    "ssim": (SSIM, 0.0055),
}


@dataclass(frozen=True)
class Schedule:
    """How much work a fit is.

    Attributes:
        starts: number of starts a view, on an even grid of azimuths and elevations.
        steps: number of steps of Adam.
    """

    starts: int
    steps: int

    def pruning(self) -> list[Pruning]:
        """Keep three eighths of the starts after step 3, an eighth after step 10, and at least two."""
        return [Pruning({3: max(2, 3 * self.starts // 8), 10: max(2, self.starts // 8)})]  # type: ignore[list-item]


@dataclass
class Found:
    """What was found in N views.

    Attributes:
        rotation_deg: (N,) errors by the category's symmetry; by the vertical axis alone where a handle is hidden.
        translation_cm: (N,) errors; None for methods without translation.
        boxes: boxes of the first views, rotation (3, 3) in OpenCV axes, translation (3,) and size (3,) in metres.
        drawing: (`SHOWN`, 3, S, S) of the first views, where something was drawn.
        results: results of the fits, where there were any.
    """

    rotation_deg: Tensor
    translation_cm: Tensor | None = None
    boxes: list[tuple[Tensor, Tensor, Tensor]] = field(default_factory=list)
    drawing: Tensor | None = None
    results: list[FitResult] = field(default_factory=list)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Plain arrays for a file."""
        found = {"rotation_deg": self.rotation_deg.numpy()}
        if self.translation_cm is not None:
            found["translation_cm"] = self.translation_cm.numpy()
        if self.boxes:
            for name, parts in zip(("rotation", "translation", "size"), zip(*self.boxes, strict=True), strict=True):
                found[f"box_{name}"] = torch.stack(parts).numpy()
        if self.drawing is not None:
            found["drawing"] = (255 * self.drawing).round().byte().numpy()
        return found


def paper_fit(
    model: CategoryModel, schedule: Schedule, energy: str = "perceptual", prior: bool = True, centred: bool = True
) -> FitPipeline:
    """The paper's fit with kfit's parts: one energy of the picture and the code prior, starts on a grid, pruned.

    It differs from the paper's by EfficientNet-Lite0 in place of VGG (unless another energy is named), by the prior's
    weight, 0.02 in place of 1, and by a compact generator where the model has one. Adam has the released code's rates.

    Where the pictures are not cut out around their objects (``centred`` false), drawings start where the mask is.
    """
    make, weight = ENERGIES[energy]
    place: list[Initializer] = [Constant({"shift": 0.0})] if centred else [FromMask()]
    return FitPipeline(
        SimilarityWarp(fixed_camera(model.generator)),
        {energy: make(), **({"prior": CodePrior()} if prior else {})},
        [
            SphereGrid(elevation_deg=(0.0, 60.0)),
            EncoderPosterior(model.encoder),
            Constant({"roll": 0.0, "scale": 1.0}),
            *place,
        ],
        Adam(RATES, betas=(0.5, 0.999)),
        weights={"prior": weight} if prior else None,
        callbacks=list(schedule.pruning()),
        num_starts=schedule.starts,
        num_steps=schedule.steps,
    )


def kfit_fit(model: CategoryModel, schedule: Schedule, depth: bool = False) -> FitPipeline:
    """kfit's own fit, with as many starts and steps as the paper's."""
    return model.pipeline(schedule.starts, schedule.steps, depth=depth)


def by_fit(model: CategoryModel, views: HeldOutViews, pipeline: FitPipeline, on_batch: Callable[[int], None]) -> Found:
    """Fit all views."""
    batch = max(1, ROWS // pipeline.num_starts)
    _, results = rotation_errors(model, views, pipeline, batch, on_batch)
    angles = [torch.cat([r.values[name] for r in results]).double() for name in ("azimuth", "elevation", "roll")]
    away = errors(rotation_from_angles(*angles), views, model.card.category)
    shifts = 100 * translation_errors(model, views, results)
    fits = [one for result in results for one in result][:SHOWN]
    boxes = []
    for fit, crop, camera in zip(fits, views.crops, views.intrinsics, strict=False):
        rotation, place, diagonal = placement(fit.values, crop, camera, model.card)
        with torch.no_grad():
            boxes.append((rotation[0], place[0], model.extents(fit.values["code"])[0].double() * diagonal))
    drawing = torch.cat([model.draw(fit.values).image for fit in fits])
    return Found(away, shifts, boxes, drawing, results)


def by_head(head: PoseNetwork, views: HeldOutViews, category: str) -> Found:
    """Each view's likeliest pose, by the head alone."""
    starts = PosePosterior(head)({}, views.observation, 1, [])
    return Found(errors(rotation_of(starts), views, category))


def by_regressor(regressor: OrientationRegressor, views: HeldOutViews, category: str) -> Found:
    """Predictions of a regressor."""
    with torch.no_grad():
        return Found(errors(regressor(views.observation.image).double(), views, category))


def by_coordinates(network: CoordinateRegressor, views: HeldOutViews, category: str) -> Found:
    """Regressed NOCS coordinates brought onto the depth; NaN where that fails."""
    observation = views.observation
    coordinates = network.coordinates(observation.image)
    rotations, shifts, boxes = [], [], []
    for number in range(observation.num_problems):
        mask, depth, camera = (observation.field(name)[number] for name in ("mask", "depth", "intrinsics"))
        rotation, place, size = torch.full((3, 3), torch.nan), torch.full((3,), torch.nan), torch.ones(3)
        with suppress(ValueError):  # nothing that could be aligned
            *pose, diagonal = pose_of_coordinates(coordinates[number], mask[0], depth[0], camera)
            rotation, place = (torch.as_tensor(part) for part in pose)
            half = coordinates[number][:, mask[0] > 0.5].abs().quantile(0.98, 1)
            size = 2 * half * diagonal
        rotations.append(rotation.double())
        shifts.append(100 * (place - views.translation[number]).norm())
        boxes.append((rotation.double(), place.double(), size.double()))
    away = errors(from_opencv(torch.stack(rotations)), views, category)
    return Found(away, torch.stack(shifts), boxes[:SHOWN])


def errors(rotation: Tensor, views: HeldOutViews, category: str) -> Tensor:
    """Rotation errors (N,) in degrees as in NOCS: by the axis where the class, or a hidden handle, is symmetric."""
    full = rotation_error(rotation, views.rotation, CATEGORIES[category].symmetry)
    return torch.where(views.visible, full, rotation_error(rotation, views.rotation, "y")).rad2deg()


def path_of(results: list[FitResult], views: HeldOutViews, category: str) -> tuple[NDArray[Any], NDArray[Any]]:
    """Energies and rotation errors in degrees (N, steps) of each view's winning start, at each step."""
    energy, rotation = [], []
    for result in results:
        rows, won = torch.arange(len(result.start)), result.start.clamp(min=0)
        energy.append(result.history.energy[:, rows, won])
        angles = (result.history.values[name][:, rows, won].double() for name in ("azimuth", "elevation", "roll"))
        rotation.append(rotation_from_angles(*angles))
    away = torch.stack([errors(row, views, category) for row in torch.cat(rotation, 1)])
    return torch.cat(energy, 1).T.numpy(), away.T.numpy()


def levels() -> Iterator[tuple[str, float]]:
    """What the robustness study changes, and how far: the first of each kind is nothing."""
    for kind, strengths in {
        "brightness": (0.0, -0.6, -0.4, -0.2, 0.2, 0.4, 0.6),
        "occlusion": (0.0, 0.1, 0.2, 0.3, 0.4),
        "shift": (0.0, 0.125, 0.25, 0.375),
    }.items():
        for strength in strengths:
            yield kind, strength
