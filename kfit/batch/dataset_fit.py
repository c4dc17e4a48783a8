"""Fits of a data set under any of Lightning's strategies; interrupted runs are resumed."""

from __future__ import annotations

import hashlib
import logging
import warnings
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from lightning import LightningModule
from torch import nn

from kfit.batch.fit_data import FitData, ImageToFit, ObjectCropper, Unreadable
from kfit.batch.results_folder import ResultsFolder
from kfit.core import FitError, Observation
from kfit.core.arguments import check_arguments
from kfit.core.check import check_names
from kfit.geometry import CATEGORIES
from kfit.models.load import BUNDLED, bundled, load
from kfit.pose.category_model import CategoryModel
from kfit.pose.model_files import read_card
from kfit.pose.observed_object import ObservedObject
from kfit.pose.result import PoseResult
from kfit.runtime.devices import cores, one_thread

_log = logging.getLogger(__name__)
READERS = 8


class DatasetFit(LightningModule):
    """Fit every object of a `kfit.batch.fit_data.FitData` and write one file for each image, atomically.

    For ``lightning predict`` or `lightning.Trainer.predict`. Images whose result is there are left alone, so a run that
    was killed is gone on with by the same command. The first process decides what is left and all take their share of
    it before anyone fits. The settings are kept in ``fit.json`` with the results, and a run with others is refused.

    An object's result depends on the seed and its image alone, with data of ``batch_size`` 1 to the last bit (on one
    kind of machine). For that each process computes with one thread, as their number would change the rounding: start
    as many processes as there are cores. Images that cannot be read and objects that cannot be fitted are warned of
    and counted, and the run goes on; objects of categories without a model are counted.

    Args:
        out: folder for the results.
        models: .safetensors files by category, in addition to the bundled models or in their place.
        num_starts, num_steps: as in `kfit.FitPipeline`.
        depth: use the images' depth, which fixes distance and size; models that draw none count as missing.
        seed: decides the random numbers.
    """

    def __init__(
        self,
        out: Path = Path("results"),
        models: dict[str, Path] | None = None,
        num_starts: int = 4,
        num_steps: int = 16,
        depth: bool = False,
        seed: int = 0,
    ) -> None:
        super().__init__()
        check_arguments(DatasetFit, locals(), num_steps=(0,), seed=(0,))
        self.folder, self.depth, self.seed = ResultsFolder(Path(out)), depth, seed
        self.num_starts, self.num_steps = num_starts, num_steps
        self.files = {name: BUNDLED / f"{name}.safetensors" for name in bundled()}
        self.files |= {name: Path(path) for name, path in (models or {}).items()}
        self.models: dict[str, CategoryModel] = {}
        self.pipelines = nn.ModuleDict()
        self.counts: Counter[str] = Counter()
        self.modelless: Counter[str] = Counter()

    def setup(self, stage: str) -> None:
        """Load the models, and agree with the other processes on what is left.

        Raises:
            FileNotFoundError, ValueError: in the first process, for data, models or a folder that cannot be used; the
                others just end.
        """
        data: Any = self.trainer.datamodule  # type: ignore[attr-defined]
        if not isinstance(data, FitData):
            raise ValueError(f"data must be a kfit.batch.fit_data.FitData, got {type(data).__name__}")
        agreed: list[str] | Exception | None = None
        if self.trainer.is_global_zero:
            try:
                self._load(data)
                names = data.names()
                agreed = self.folder.left(names, self._settings | data.settings)
                _log.info("%d of %d images are to be fitted into %s", len(agreed), len(names), self.folder.path)
            except (OSError, ValueError) as error:
                agreed = error
        agreed = self.trainer.strategy.broadcast(agreed)
        if not isinstance(agreed, list):
            # If they failed, Lightning would kill the first before it can report the error.
            raise agreed if self.trainer.is_global_zero and agreed is not None else SystemExit(0)
        if not self.trainer.is_global_zero:
            self._load(data)
        cropper = ObjectCropper(
            {name: (model.card.known, model.image_size) for name, model in self.models.items()}, self.depth
        )
        # A GPU fits faster than one process reads, so reading is done in the background.
        shared = max(1, cores() // self.trainer.world_size - 1)
        on_cpu = self.trainer.strategy.root_device.type == "cpu"
        data.plan(agreed, cropper, 0 if on_cpu else min(READERS, shared))

    def on_predict_start(self) -> None:
        """Move the models to where they are to compute."""
        for model in self.models.values():
            model.to(self.device)

    def predict_step(self, batch: list[ImageToFit | Unreadable], batch_idx: int) -> int:
        """Fit the objects of some images, those of a category at once, and write the images' results.

        Returns:
            Number of objects fitted.
        """
        data: Any = self.trainer.datamodule  # type: ignore[attr-defined]
        images = []
        for image in batch:
            if isinstance(image, Unreadable):
                self.counts["unreadable"] += 1
                warnings.warn(f"there will be no {image.name}: {image.why}", stacklevel=1)
            elif not self.folder.has(image.name):  # by another run, since
                images.append(image)
        things = [(image, number) for image in images for number in range(len(image.objects))]
        answers: dict[tuple[str, int], PoseResult | str] = {}
        for category in sorted({image.objects[number].category for image, number in things}):
            group = [(image, number) for image, number in things if image.objects[number].category == category]
            found = self._fit(category, group)
            answers |= {(image.name, number): one for (image, number), one in zip(group, found, strict=True)}
        for image in images:
            self._keep(data, image, [answers[image.name, number] for number in range(len(image.objects))])
        return sum(isinstance(answer, PoseResult) for answer in answers.values())

    def on_predict_end(self) -> None:
        """Report what was done, and wait for the processes that were started on this machine."""
        parts = [f"{self.counts['objects']} objects in {self.counts['images']} images fitted into {self.folder.path}"]
        parts += [
            f"{count} {name} not, for there is {self._no_model}" for name, count in sorted(self.modelless.items())
        ]
        if self.counts["unfitted"]:
            parts.append(f"{self.counts['unfitted']} other objects not")
        if self.counts["unreadable"]:
            parts.append(f"{self.counts['unreadable']} images cannot be used")
        count = self.trainer.world_size
        who = f"process {self.trainer.global_rank + 1} of {count}: " if count > 1 else ""
        _log.info("%s%s", who, "; ".join(parts))
        # A barrier would give up after half an hour, and Lightning's launcher does not wait.
        for process in getattr(self.trainer.strategy.launcher, "procs", []):
            process.wait()

    def _load(self, data: FitData) -> None:
        check_names("models", self.files, {*CATEGORIES, *data.categories})
        for category in data.categories:
            if category not in self.files:
                continue
            model = load(self.files[category])
            if model.card.category != category:
                raise ValueError(f"models: {self.files[category]} is of the category {model.card.category}")
            if self.depth and "depth" not in model.drawn:
                continue
            self.models[category] = model
        if not self.models:
            names = ", ".join(data.categories)
            known = ", ".join(sorted(self.files))
            raise ValueError(f"there is {self._no_model} of {names}; there are models of {known}")

    @property
    def _no_model(self) -> str:
        return "no model that draws depth" if self.depth else "no model"

    @property
    def _settings(self) -> dict[str, Any]:
        settings = {name: getattr(self, name) for name in ("num_starts", "num_steps", "depth", "seed")}
        settings["precision"] = str(self.trainer.precision)
        return settings | {f"model of {name}": _digest(self.files[name]) for name in sorted(self.models)}

    def _fit(self, category: str, things: Sequence[tuple[ImageToFit, int]]) -> list[PoseResult | str]:
        """Answers for objects of one category, or sentences."""
        if category not in self.models:
            self.modelless[category] += len(things)
        there = [(image.observed[number], image.objects[number].key) for image, number in things]
        answers: dict[int, PoseResult | str] = {n: one for n, (one, _) in enumerate(there) if isinstance(one, str)}
        for lens_known in (True, False):
            fine = {
                n: (one, key)
                for n, (one, key) in enumerate(there)
                if isinstance(one, ObservedObject) and one.lens_known == lens_known
            }
            if fine:
                observed, keys = zip(*fine.values(), strict=True)
                answers |= zip(fine, self._answers(category, lens_known, observed, keys), strict=True)
        return [answers[n] for n in range(len(there))]

    def _answers(
        self, category: str, lens_known: bool, observed: Sequence[ObservedObject], keys: tuple[int, ...]
    ) -> list[PoseResult | str]:
        observation = replace(Observation.cat([one.observation for one in observed]), keys=keys)
        observation = self.models[category].read(observation.map(lambda tensor: tensor.to(self.device)))
        with one_thread():  # so that results do not depend on how many processes share the cores
            try:
                fit = self._pipeline(category, lens_known)(observation, seed=self.seed)
            except FitError as error:
                return [str(error)] * len(observed)
            failed = "every start of the fit became NaN or infinite"
            return [answer or failed for answer in self.models[category].answers(fit, observed, observation)]

    def _pipeline(self, category: str, lens_known: bool) -> nn.Module:
        """The fit of objects of a category, built when first needed."""
        name = category if lens_known else f"{category}, lens unknown"
        if name not in self.pipelines:
            with torch.inference_mode(False):  # what is made under it, as in `predict`, could pass no gradient
                self.pipelines[name] = self.models[category].pipeline(
                    self.num_starts, self.num_steps, depth=self.depth, lens_known=lens_known
                )
        return self.pipelines[name]

    def _keep(self, data: FitData, image: ImageToFit, answers: Sequence[PoseResult | str]) -> None:
        self.counts["objects"] += sum(isinstance(answer, PoseResult) for answer in answers)
        for thing, answer in zip(image.objects, answers, strict=True):
            if isinstance(answer, str) and thing.category in self.models:
                self.counts["unfitted"] += 1
                warnings.warn(f"a {thing.category} of {image.name} is not fitted: {answer}", stacklevel=1)
        if self.folder.write(image.name, lambda path: data.write(path, image, answers)):
            self.counts["images"] += 1


def _digest(path: Path) -> str:
    """Distinguish a model from others by its weights and its card, which files of version 0.1 have elsewhere."""
    return hashlib.sha256(path.read_bytes() + read_card(path).to_json().encode()).hexdigest()[:12]
