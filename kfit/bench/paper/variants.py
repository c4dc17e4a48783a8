"""The networks that the paper compares, each trained by ``lightning fit`` with the same number of pictures."""

from __future__ import annotations

import json
import shlex
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml  # type: ignore[import-untyped]

from kfit.runtime.atomic_write import atomic_write
from kfit.runtime.console import log

# Checkpoints are written this often, so that little is lost to an interruption.
EPOCHS = 6
# File in a training's folder with its settings.
RECORD = "settings.json"


@dataclass(frozen=True)
class Variant:
    """One network.

    Attributes:
        title: title in tables.
        recipe: file that trains it.
        settings: words after the recipe in which it differs.
        networks: networks that `kfit.models.read_checkpoint` finds in its checkpoint; by default a generator's.
    """

    title: str
    recipe: str = "vae3d.yaml"
    settings: tuple[str, ...] = ()
    networks: tuple[str, ...] = ("generator", "encoder", "extents")


def _code(dim: int) -> tuple[str, ...]:
    parts = ("generator", "encoder", "extents")
    return tuple(word for part in parts for word in (f"--model.init_args.{part}.init_args.code_dim", str(dim)))


PAPER = "vae3d_paper.yaml"


def _printed_kl(dim: int = 16) -> tuple[str, str]:
    """Words for the paper's λ = 0.01, in the released code's 10 · mean |I − Î| + 0.01 · (KL averaged over the code).

    Taken for kfit's λ in mean |I − Î| + λ · (KL summed over the code), 0.01 would make codes collapse.
    """
    return "--model.init_args.kl_weight", f"{0.01 / 10 / dim:g}"


WITH_DEPTH = (
    *("--model.init_args.generator.init_args.depth", "true"),
    *("--model.init_args.losses.depth", "kfit.energies.Depth"),
)
VARIANTS = {
    "full": Variant("compact VAE3D, code of 16"),
    "without_3d": Variant("compact VAE2D (w/o 3D)", settings=("--model.init_args.generator", "kfit.generators.VAE2D")),
    "without_vae": Variant("compact VAE3D, no KL term (w/o VAE)", settings=("--model.init_args.kl_weight", "0")),
    "code_4": Variant("compact VAE3D, code of 4", settings=_code(4)),
    "code_128": Variant("compact VAE3D, code of 128", settings=_code(128)),
    "field": Variant("RadianceField", settings=("--model.init_args.generator", "kfit.generators.RadianceField")),
    "paper": Variant("the paper's VAE3D, code of 16", PAPER, _printed_kl()),
    "paper_without_3d": Variant(
        "VAE2D (w/o 3D)", PAPER, (*_printed_kl(), "--model.init_args.generator", "kfit.generators.VAE2D")
    ),
    "paper_without_vae": Variant(
        "the paper's VAE3D, no KL term (w/o VAE)", PAPER, ("--model.init_args.kl_weight", "0")
    ),
    "paper_code_4": Variant("the paper's VAE3D, code of 4", PAPER, (*_printed_kl(4), *_code(4))),
    "paper_code_128": Variant("the paper's VAE3D, code of 128", PAPER, (*_printed_kl(128), *_code(128))),
    "paper_depth": Variant("the paper's VAE3D, depth as a channel", PAPER, (*_printed_kl(), *WITH_DEPTH)),
    "regressor": Variant("VGG16 regressor", "regressor.yaml", networks=("regressor",)),
    "coordinates": Variant("NOCS-style, RGB-D", "nocs_regressor.yaml", networks=("regressor",)),
    "pose_head": Variant("pose head alone", "pose_head.yaml", networks=("pose_head",)),
}


def is_published(variant: str) -> bool:
    """Whether a variant is of the paper's own configuration."""
    return VARIANTS[variant].recipe == PAPER


@dataclass(frozen=True)
class Training:
    """What every variant is trained with.

    Attributes:
        steps: number of steps of the optimizer, a multiple of `EPOCHS`; each sees as many pairs as the recipes' batch
            holds.
        objects: procedural objects, with ten views each.
        recipes: folder of the recipes.
        cache: folder of rendered views.
        runs: folder of trainings; one a category and variant.
        vgg16: file of VGG16's ImageNet weights that the regressor starts from, as the paper's; None starts it from
            nothing.
        seed: seed of the training's random numbers and objects.
    """

    steps: int
    objects: int
    recipes: Path
    cache: Path
    runs: Path
    vgg16: str | None = None
    seed: int = 0

    def folder(self, name: str, category: str) -> Path:
        return self.place(category) / name

    def place(self, category: str) -> Path:
        """Folder of a category's trainings and figures; those of another seed than 0 have one of their own."""
        return self.runs / category if not self.seed else self.runs / f"seed_{self.seed}" / category

    def command(self, name: str, category: str) -> list[str]:
        """Words after ``lightning`` that train a variant."""
        variant = VARIANTS[name]
        started = ("--model.init_args.weights", self.vgg16) if name == "regressor" and self.vgg16 else ()
        return [
            *("fit", "-c", str(self.recipes / variant.recipe), *variant.settings, *started),
            *("--data.category", category, "--data.num_objects", str(self.objects), "--data.batch_size", "32"),
            *("--data.cache_dir", str(self.cache), "--trainer.default_root_dir", str(self.folder(name, category))),
            *(("--seed_everything", str(self.seed), "--data.seed", str(self.seed)) if self.seed else ()),
            *("--trainer.max_epochs", str(EPOCHS), "--trainer.limit_train_batches", str(self.steps // EPOCHS)),
        ]

    def checkpoint(self, name: str, category: str) -> Path | None:
        """The newest checkpoint of a variant, finished or not."""
        found = self.folder(name, category).glob("lightning_logs/version_*/checkpoints/last.ckpt")
        return max(found, key=lambda path: path.stat().st_mtime, default=None)

    def trained(self, name: str, category: str) -> Path:
        """The checkpoint of a variant, trained now, or to its end, unless it is.

        Raises:
            FileNotFoundError: if there is no such recipe.
            RuntimeError: if training fails, or ends before its last step.
            ValueError: if the folder holds a training with other settings.
        """
        folder, begun = self.folder(name, category), self.checkpoint(name, category)
        if begun is None:
            settings = json.dumps(self._settings(name), indent=1)
            atomic_write(folder, {RECORD: lambda path: path.write_text(settings)})
        else:
            self.check(name, category)
            if self._steps(begun) >= self.steps:
                return begun
        words = self.command(name, category) + ([] if begun is None else ["--ckpt_path", str(begun)])
        log.info("training %s, %s:\n  lightning %s", category, VARIANTS[name].title, shlex.join(words))
        self._run(words, folder / "training.log")
        made = self.checkpoint(name, category)
        if made is None:
            raise RuntimeError(f"training left no checkpoint in {folder}; see training.log there")
        if (done := self._steps(made)) < self.steps:
            raise RuntimeError(f"{folder} was trained for {done} steps instead of {self.steps}; give more --objects")
        return made

    def check(self, name: str, category: str) -> None:
        """Compare the settings with those of a variant's training that was begun.

        Raises:
            FileNotFoundError: if there is no such recipe.
            ValueError: if they differ.
        """
        record, settings = self.folder(name, category) / RECORD, self._settings(name)
        before = json.loads(record.read_text(encoding="utf-8")) if record.is_file() else settings
        if changed := [key for key, value in settings.items() if before.get(key) != value]:
            raise ValueError(f"{record.parent} was trained with another {' and '.join(changed)}; choose another --runs")

    def _settings(self, name: str) -> dict[str, Any]:
        recipe = self.recipes / VARIANTS[name].recipe
        if not recipe.is_file():
            raise FileNotFoundError(f"no recipe at {recipe}; run this in kfit's checkout, or pass --recipes DIR")
        words = yaml.safe_dump(yaml.safe_load(recipe.read_text(encoding="utf-8"))).split()
        weights = self.vgg16 and Path(self.vgg16).name if name == "regressor" else None
        whole = " ".join((*words, *VARIANTS[name].settings))
        return {"train-steps": self.steps, "objects": self.objects, "vgg16": weights, "recipe": whole}

    @staticmethod
    def _run(words: Sequence[str], log: Path) -> None:
        code = "import sys; from kfit.training.lightning_cli import main; main(sys.argv[1:])"
        with log.open("ab") as file:
            arguments = [*words, "--trainer.enable_progress_bar", "false"]
            done = subprocess.run([sys.executable, "-c", code, *arguments], stdout=file, stderr=subprocess.STDOUT)
        if done.returncode:
            raise RuntimeError(f"training failed with exit status {done.returncode}; see {log}")

    @staticmethod
    def _steps(checkpoint: Path) -> int:
        import torch

        return int(torch.load(checkpoint, map_location="cpu", weights_only=True)["global_step"])
