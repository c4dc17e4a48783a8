"""What is measured for the paper's tables, one file a category and unit, so that nothing is measured twice."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from kfit import FitPipeline
from kfit.baselines import CoordinateRegressor, OrientationRegressor
from kfit.bench.held_out_views import HeldOutViews, held_out_views
from kfit.bench.paper import drawings, fits
from kfit.bench.paper.fits import Schedule
from kfit.bench.paper.published import published_fit
from kfit.bench.paper.variants import VARIANTS, Training, is_published
from kfit.core import Observation
from kfit.geometry import PoseNetwork
from kfit.models import load, read_checkpoint
from kfit.models.pack import pack
from kfit.pose import CategoryModel
from kfit.runtime.atomic_write import atomic_write
from kfit.training.random_corruption import brightened, occluded, shifted

Arrays = dict[str, NDArray[Any]]
# A unit is a variant, or a variant and how it is fitted.
TABLES = {
    "1a": ("without_3d", "without_vae", "full"),
    "paper_1a": ("paper_without_3d", "paper_without_vae", "paper"),
    "2a": ("full+l1", "full+l2", "full+ssim", "full+no_prior", "full", "full+kfit"),
    "paper_2a": ("paper+l1", "paper+l2", "paper+ssim", "paper+no_prior", "paper"),
    "1b": ("code_4", "full", "code_128"),
    "paper_1b": ("paper_code_4", "paper", "paper_code_128"),
    "curves": ("full", "field+kfit", "field+depth", "regressor", "coordinates", "pose_head"),
    "paper_curves": ("paper", "paper_depth+depth", "regressor", "coordinates", "pose_head"),
    "robustness": ("full+robustness", "regressor+robustness"),
    "paper_robustness": ("paper+robustness", "regressor+robustness"),
    "backbone": ("full", "field", "full+kfit", "field+kfit"),
}
"""Units by table, the most important first; those of the paper's own configuration have names with ``paper_``."""
# The row that the others of a table are compared with.
REFERENCE = {
    **dict.fromkeys(("1a", "1b", "2a", "backbone"), "full"),
    **dict.fromkeys(("paper_1a", "paper_1b", "paper_2a"), "paper"),
}
# Robustness is studied on the paper's category, and on so many views, for each is fitted at every strength.
STUDIED, ROBUST_VIEWS = "laptop", 20
SAMPLES = 6


@dataclass(frozen=True)
class Measuring:
    """How units are measured.

    Attributes:
        training: training settings of the variants.
        schedule: schedule of kfit's fits.
        published: schedule of the fits in the paper's configuration.
        views: views of that many unseen objects.
        seed: chooses them.
        report: called with the current task, and the numbers of finished and all views.
        base: variant whose model crops the views for methods that draw nothing.
    """

    training: Training
    schedule: Schedule
    published: Schedule
    views: int
    seed: int
    report: Callable[[str, int, int], None]
    base: str = "full"

    def saved(self, unit: str, category: str) -> Arrays | None:
        """A unit's arrays if they were measured before in the same way.

        Raises:
            ValueError: if the variant was trained with other settings.
        """
        variant = unit.partition("+")[0]
        checkpoint, path = self.training.checkpoint(variant, category), self._file(unit, category)
        if checkpoint is None or not path.is_file():
            return None
        self.training.check(variant, category)
        with np.load(path) as file:
            return dict(file) if str(file["settings"]) == self._settings(variant, checkpoint) else None

    def measured(self, unit: str, category: str) -> Arrays:
        """Train a unit's variant unless it is trained, measure the unit, and write its file."""
        variant, _, how = unit.partition("+")
        self.report(f"{category}, training {VARIANTS[variant].title}", 0, self.views)
        checkpoint, path = self.training.trained(variant, category), self._file(unit, category)
        settings = {"settings": np.array(self._settings(variant, checkpoint))}
        arrays = self._measure(variant, how, category, checkpoint) | settings
        atomic_write(path.parent, {path.name: lambda place: np.savez_compressed(place, **arrays)})  # type: ignore[arg-type]
        return arrays

    def _file(self, unit: str, category: str) -> Path:
        return self.training.place(category) / f"{unit}.npz"

    def _settings(self, variant: str, checkpoint: Path) -> str:
        asked = {"views": self.views, "seed": self.seed, "steps": self.training.steps}
        asked |= asdict(self.schedule_of(variant)) | {"trained": checkpoint.stat().st_mtime_ns}
        return json.dumps(asked)

    def schedule_of(self, variant: str) -> Schedule:
        """Schedule of a variant's fits."""
        return self.published if is_published(variant) else self.schedule

    def _measure(self, variant: str, how: str, category: str, checkpoint: Path) -> Arrays:
        names = VARIANTS[variant].networks
        fitted = variant if "generator" in names else self.base
        model = self._model(fitted, category, self.training.trained(fitted, category))
        if how == "robustness":
            return self._robustness(variant, category, checkpoint, model)
        views = held_out_views(model, self.views, self.seed)
        arrays = {
            "photos": (255 * views.observation.image[: fits.SHOWN].permute(0, 2, 3, 1)).round().byte().numpy(),
            "camera": views.observation.field("intrinsics")[: fits.SHOWN].numpy(),
        }
        if "generator" not in names:
            return arrays | self._read_out(variant, category, checkpoint, views).arrays()
        found = fits.by_fit(
            model, views, self._pipeline(variant, model, how), self._reporter(f"{category}, {variant} {how}")
        )
        if not how:
            arrays["samples"] = (255 * drawings.prior_samples(model, SAMPLES, self.seed)).round().byte().numpy()
            arrays["l1"] = np.array(drawings.novel_view_l1(model, self.training.cache, self.views))
            arrays["multiply_adds"] = np.array(drawings.multiply_adds(model.generator))
            arrays["path_energy"], arrays["path_rotation"] = fits.path_of(found.results, views, category)
        return arrays | found.arrays()

    def _robustness(self, variant: str, category: str, checkpoint: Path, model: CategoryModel) -> Arrays:
        """Errors at each strength of each change, and of objects of the training."""
        arrays: Arrays = {}
        count = min(self.views, ROBUST_VIEWS)
        held_out = held_out_views(model, count, self.seed)
        trained = held_out_views(model, count, self.seed, training_seed=self.training.seed)
        places = {"instances +0": trained}
        for kind, strength in fits.levels():
            changed = changer(kind, strength)(held_out.observation)
            places[f"{kind} {strength:+g}"] = replace(held_out, observation=changed)
        for number, (name, views) in enumerate(places.items()):
            self.report(f"{category}, {variant}, {name}", number, len(places))
            if variant == "regressor":
                found = self._read_out(variant, category, checkpoint, views)
            else:
                pipeline = self._pipeline(variant, model, "robustness")
                found = fits.by_fit(model, views, pipeline, lambda done: None)
            arrays[name] = found.rotation_deg.numpy()
        return arrays

    def _pipeline(self, variant: str, model: CategoryModel, how: str) -> FitPipeline:
        if is_published(variant):
            assert self.training.vgg16 is not None
            return published_fit(model, self.training.vgg16, self.published, how)
        if how == "robustness":
            return fits.paper_fit(model, self.schedule, centred=False)
        if how in ("kfit", "depth"):
            return fits.kfit_fit(model, self.schedule, how == "depth")
        return fits.paper_fit(model, self.schedule, how if how in fits.ENERGIES else "perceptual", how != "no_prior")

    def _read_out(self, variant: str, category: str, checkpoint: Path, views: HeldOutViews) -> fits.Found:
        networks, _ = read_checkpoint(checkpoint, VARIANTS[variant].networks)
        (network,) = networks.values()
        if isinstance(network, OrientationRegressor):
            return fits.by_regressor(network, views, category)
        if isinstance(network, CoordinateRegressor):
            return fits.by_coordinates(network, views, category)
        assert isinstance(network, PoseNetwork)
        return fits.by_head(network, views, category)

    def _model(self, variant: str, category: str, checkpoint: Path) -> CategoryModel:
        out = self.training.folder(variant, category) / "model.safetensors"
        if not out.is_file() or out.stat().st_mtime_ns < checkpoint.stat().st_mtime_ns:
            pack(checkpoint, out)
        return load(str(out))

    def _reporter(self, what: str) -> Callable[[int], None]:
        return lambda done: self.report(what, done, self.views)


def changer(kind: str, strength: float) -> Callable[[Observation], Observation]:
    """What changes views by one of `kfit.bench.paper.fits.levels`, each view in the same way at every strength."""

    def change(observation: Observation) -> Observation:
        image, mask, rng = observation.image, observation.field("mask"), torch.Generator().manual_seed(0)
        if kind == "brightness":
            image = brightened(image, mask, 1 + strength)
        elif kind == "occlusion":
            image, mask = occluded(image, mask, strength, rng)
        else:
            turn = 2 * torch.pi * torch.rand(len(image), generator=rng)
            image, mask = shifted(image, mask, strength * torch.stack([turn.cos(), turn.sin()], 1))
        return replace(observation, image=image, mask=mask)

    return change
