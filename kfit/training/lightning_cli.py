"""``lightning fit -c recipe.yaml``: Lightning's command line for kfit's parts and the user's own."""

from __future__ import annotations

import importlib
import logging
import os
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

from jsonargparse import ArgumentError, Namespace
from lightning.fabric.plugins import TorchCheckpointIO
from lightning.pytorch import Callback, LightningDataModule, LightningModule, Trainer
from lightning.pytorch.callbacks import LearningRateMonitor
from lightning.pytorch.cli import LightningArgumentParser, LightningCLI
from lightning.pytorch.loggers import CSVLogger, TensorBoardLogger
from torch import distributed

from kfit.data import ViewsDataModule, read_category
from kfit.geometry.categories import CATEGORIES, Category
from kfit.runtime.class_paths import current_paths, current_word, read_old_paths
from kfit.runtime.console import see_working_folder, session
from kfit.runtime.did_you_mean import option_suggestion
from kfit.runtime.help_page import HelpPage
from kfit.runtime.parse_errors import sentence
from kfit.runtime.recipe_limits import check_recipe, no_exit
from kfit.runtime.torch_file import read_torch
from kfit.training import AtomicCheckpoints, ConditionalVAE, PictureGrid, Provenance
from kfit.training.continued_log import ContinuedCSVLogger, run_of

# Arguments of the model's parts that the category of the data decides, where a part has such an argument.
KNOWN: dict[str, Callable[[Category], object]] = {
    "generator.init_args.unit_fraction": lambda category: category.unit_fraction,
    "pose_head.init_args.symmetry": lambda category: category.symmetry,
    "pose_head.init_args.upright": lambda category: category.upright,
    "regressor.init_args.symmetry": lambda category: category.symmetry,
    "symmetry": lambda category: category.symmetry,
    "unit_fraction": lambda category: category.unit_fraction,
}
# The same of procedural objects alone: somebody's meshes may be of any shape.
KNOWN_OF_PROCEDURAL: dict[str, Callable[[Category], object]] = {
    "generator.init_args.sides": lambda category: list(category.sides),
}
COMMANDS = {
    "fit": "kfit fit -c recipes/radiance_field.yaml --data.category mug",
    "validate": "kfit validate -c recipes/smoke.yaml --ckpt_path last.ckpt",
    "test": "kfit test -c recipes/smoke.yaml --ckpt_path last.ckpt",
    "predict": "kfit predict -c recipes/fit_dataset.yaml --data.root NOCS --data.split real_test --model.out results",
}
"""Examples by command."""
# Internal messages of Lightning and torch.
NEEDLESS = (r"`isinstance\(treespec, LeafSpec\)` is deprecated", r"Precision .* is not supported by the model summary")
# Elsewhere than in training the state of training's callbacks is of no use; averaged weights are those that a
# checkpoint holds.
NEEDLESS_ELSEWHERE = (
    r"You're using the WeightAveraging callback, but loading",
    r"The dirpath has changed from",
    r"Be aware that when using `ckpt_path`, callbacks",
)


class _Parser(LightningArgumentParser):
    """Reads class paths of earlier versions, also in the hyperparameters of checkpoints."""

    def parse_object(self, cfg_obj: Any, *args: Any, **kwargs: Any) -> Any:
        return super().parse_object(current_paths(cfg_obj), *args, **kwargs)


class _CLI(LightningCLI):
    def parse_arguments(self, parser: LightningArgumentParser, args: Any) -> None:
        """Parse the arguments, or raise a ValueError of one sentence."""
        try:
            with no_exit():
                super().parse_arguments(parser, args)
        except (ArgumentError, TypeError) as error:
            command = " ".join(["kfit", *(word for word in args[:1] if word in COMMANDS)])
            message = sentence(str(error))
            if message.startswith("Problems parsing config"):  # the message lacks the file
                recipes = [name for option, name in pairwise(args) if option in ("-c", "--config")]
                message = f"{', '.join(recipes)}: {message}"
            meant = option_suggestion(message, args, parser)
            raise ValueError(f"{message};{meant} `{command} --help` shows the usage") from None

    def instantiate_classes(self) -> None:
        """Build the parts; errors become one sentence."""
        try:
            with no_exit():
                super().instantiate_classes()
        except (ValueError, TypeError) as error:
            raise ValueError(sentence(str(error))) from error

    def before_instantiate_classes(self) -> None:
        if self.subcommand == "predict":
            self.save_config_callback = None  # it would write into the working folder; results have their settings
        # Not `link_arguments`: checkpoints leave out what it fills in, and could not be rebuilt.
        config = self.config.get(str(self.subcommand), self.config)
        category = _category_of(config)
        drawn = all(config.get(f"data.init_args.{source}") is None for source in ("meshes", "views"))
        for argument, known in {**KNOWN, **(KNOWN_OF_PROCEDURAL if drawn else {})}.items():
            if category is not None and f"model.init_args.{argument}" in config:
                config[f"model.init_args.{argument}"] = known(category)
        if category is not None and not category.mirror and "model.init_args.mirror" in config:
            config["model.init_args.mirror"] = False

    def instantiate_trainer(self, **kwargs: Any) -> Trainer:
        """Build the recipe's trainer, by default with TensorBoard's and CSV logs in one folder.

        A fit with a logger logs its learning rate, and pictures if the model draws some.
        """
        settings = self._get(self.config_init, "trainer", default={})
        logger, callbacks = settings.get("logger"), settings.get("callbacks") or []
        if logger in (None, True) and self.subcommand != "predict" and not settings.get("barebones"):
            # The first one finds the number of the version, and minds a folder that is not empty.
            table = self._table(settings.get("default_root_dir") or os.getcwd())
            board = TensorBoardLogger(table.save_dir, table.name, table.version, default_hp_metric=False)
            logger = kwargs["logger"] = [table, board]
        if self.subcommand == "fit":
            callbacks = list(callbacks) if isinstance(callbacks, list) else [callbacks]
            defaults: list[Callback] = [Provenance(self._parser("fit").dump(self.config["fit"], skip_none=False))]
            defaults += [LearningRateMonitor()] if logger else []
            defaults += [PictureGrid()] if logger and isinstance(self.model, ConditionalVAE) else []
            named = {type(callback) for callback in callbacks}
            kwargs["callbacks"] = callbacks + [callback for callback in defaults if type(callback) not in named]
        trainer = super().instantiate_trainer(**kwargs)
        # Those that a recipe or a strategy brings know better how they are to be written.
        if type(trainer.strategy.checkpoint_io) is TorchCheckpointIO:
            trainer.strategy.checkpoint_io = AtomicCheckpoints()
        return trainer

    def _table(self, root: str) -> CSVLogger:
        """A table in the run's next folder; in that of the checkpoint where a fit goes on."""
        checkpoint = self.config[str(self.subcommand)].get("ckpt_path")
        run = run_of(checkpoint) if self.subcommand == "fit" else None
        if run is None:
            return CSVLogger(root)
        warnings.filterwarnings("ignore", message="Checkpoint directory .* exists and is not empty")
        try:
            step = int(read_torch(Path(str(checkpoint)))["global_step"])
        except (ValueError, KeyError, TypeError):  # Lightning itself says what is wrong with it
            step = sys.maxsize
        return ContinuedCSVLogger(run, step)


def _category_of(config: Namespace) -> Category | None:
    """The category of a recipe's data, None where the data has none or is another's class with words of its own."""
    value, path = config.get("data.init_args.category"), config.get("data.class_path")
    if value is None or not isinstance(path, str):
        return None
    if isinstance(value, Namespace):
        # Of a file that jsonargparse has read it keeps the path.
        return Category.of_dict({name: one for name, one in value.as_dict().items() if name != "__path__"})
    module, _, name = path.rpartition(".")
    own = issubclass(getattr(importlib.import_module(module), name), ViewsDataModule)
    return read_category(value) if own else CATEGORIES.get(str(value))


def main(args: Sequence[str] | None = None) -> None:
    """Run Lightning's command line: fit, validate, test or predict, by a recipe.

    Parts are named by import path (``class_path``), so a class in a file of the working folder can be used.
    `kfit.runtime.console.ENDINGS` lists its exit codes.

    Args:
        args: arguments after the program's name; by default those of the process.
    """
    with session(args) as words:
        run(words)


@contextmanager
def _no_group_left() -> Iterator[None]:
    """End the group of processes, whose threads Python's end would stop inside torch, which aborts now and then."""
    try:
        yield
    finally:
        if distributed.is_available() and distributed.is_initialized():
            distributed.destroy_process_group()


@_no_group_left()
def run(words: Sequence[str], callbacks: Sequence[Callback] = ()) -> None:
    """Run Lightning's command line with these arguments, and with callbacks in addition to the recipe's."""
    for before, word in zip(["", *words], words, strict=False):
        place = word.partition("=")[2] if word.startswith("--config=") else word
        if (before in ("-c", "--config") or place.endswith((".yaml", ".yml"))) and Path(place).is_file():
            check_recipe(place)
    see_working_folder()
    read_old_paths()
    # The warning appears for all arguments that differ from the process's.
    warnings.filterwarnings("ignore", message="LightningCLI's args parameter")
    for needless in NEEDLESS + (() if words[:1] == ["fit"] else NEEDLESS_ELSEWHERE):
        warnings.filterwarnings("ignore", message=needless)
    logging.getLogger("lightning.pytorch.utilities.rank_zero").addFilter(_is_no_advertisement)
    defaults: dict[str, Any] = {"callbacks": list(callbacks)} if callbacks else {}
    if not (log := logging.getLogger("kfit")).isEnabledFor(logging.WARNING):
        for part in ("pytorch", "fabric"):
            logging.getLogger(f"lightning.{part}").setLevel(log.level)
        defaults |= {"enable_progress_bar": False, "enable_model_summary": False}
    _CLI(
        LightningModule,
        LightningDataModule,
        subclass_mode_model=True,
        subclass_mode_data=True,
        auto_configure_optimizers=False,
        seed_everything_default=0,
        trainer_defaults=defaults or None,
        save_config_kwargs={"overwrite": True},
        parser_class=_Parser,
        # The usage that would be listed otherwise names some eighty options.
        parser_kwargs={
            "prog": "kfit",
            "formatter_class": HelpPage,
            "exit_on_error": False,
            **{
                name: {
                    "exit_on_error": False,
                    "usage": f"kfit {name} -c RECIPE [--OPTION VALUE …]",
                    "epilog": f"example:\n  {example}",
                }
                for name, example in COMMANDS.items()
            },
        },
        args=[current_word(word) for word in words],
    )


def _is_no_advertisement(record: logging.LogRecord) -> bool:
    return "Tip: For seamless cloud" not in record.getMessage()
