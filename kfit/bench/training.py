"""What a training step costs: steps a second, the wait for data, and the share of the machine's matrix rate."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jsonargparse import ArgumentParser, Namespace

from kfit.bench.accuracy import command
from kfit.bench.accuracy_page import Section
from kfit.bench.page import lightning_silent, show, write_page
from kfit.runtime.console import progress

if TYPE_CHECKING:
    from lightning.pytorch import Callback

    from kfit.training.stopwatch import Stopwatch

RECIPES = ["recipes/vae3d.yaml", "recipes/radiance_field.yaml", "recipes/pose_head.yaml"]


def parser() -> ArgumentParser:
    """Arguments of ``kfit bench training``."""
    parser = ArgumentParser(
        description="Train by recipes for some steps as `lightning fit` does, on a few objects that are rendered for "
        "it, and print what a step costs, how long it waits for its data, and how near its convolutions and products "
        "come to the rate at which the machine multiplies matrices.",
        epilog="example:\n  kfit bench training --recipes '[recipes/vae3d_paper.yaml]' --steps 10",
    )
    parser.add_argument(
        "--recipes",
        type=list[str],
        default=RECIPES,
        metavar="[RECIPE.yaml,…]",
        help="of trainings (default: recipes/vae3d.yaml, radiance_field.yaml and pose_head.yaml)",
    )
    parser.add_argument("--category", type=str, default="mug", help="procedural category")
    parser.add_argument("--steps", type=int, default=20, help="steps that are timed, after five that are not")
    parser.add_argument("--out", type=str, default=None, metavar="DIR", help="write README.md there (default: nowhere)")
    return parser


def run(args: Namespace) -> None:
    """Measure, print the table, and write it where it is wanted."""
    if args.steps < 1:
        raise ValueError(f"--steps must be at least 1, got {args.steps}")
    if not args.recipes:
        raise ValueError("--recipes must name at least one recipe, got none")
    for recipe in args.recipes:
        if not Path(recipe).is_file():
            raise FileNotFoundError(f"there is no recipe {recipe}")
    with tempfile.TemporaryDirectory() as folder:
        found = {recipe: measured(recipe, args.category, args.steps, folder) for recipe in args.recipes}
    table = section(found)
    show([table], 120)
    if args.out:
        repeat = command("training", args, parser().get_defaults())
        write_page(args.out, "What a training step costs", repeat, [table])


def measured(recipe: str, category: str, steps: int, folder: str) -> Stopwatch:
    """Train for some steps, as `lightning fit` does, without keeping anything."""
    from kfit.training import lightning_cli as lightning
    from kfit.training.stopwatch import Stopwatch

    clock = Stopwatch(warm_up=5)
    words = [
        "fit",
        "-c",
        recipe,
        "--data.category",
        category,
        "--data.num_objects",
        "60",
        "--data.num_val_objects",
        "2",
    ]
    words += ["--data.cache_dir", folder, "--trainer.max_steps", str(5 + steps), "--trainer.max_epochs", "1000"]
    words += ["--trainer.logger", "false", "--trainer.callbacks", "null", "--trainer.enable_progress_bar", "false"]
    words += ["--trainer.enable_checkpointing", "false", "--trainer.enable_model_summary", "false"]
    words += ["--trainer.limit_val_batches", "0", "--trainer.default_root_dir", folder]
    with lightning_silent():
        lightning.run(words, callbacks=[clock, _steps_shown(Path(recipe).stem, 5 + steps)])
    return clock


def _steps_shown(name: str, steps: int) -> Callback:
    """A bar of training steps, from the first one on: before it, the views that are rendered have one of their own."""
    from lightning.pytorch import Callback

    class Shown(Callback):
        def on_train_start(self, *args: Any) -> None:
            self.bar = progress()
            self.bar.start()
            self.task = self.bar.add_task(f"training by {name}", total=steps)

        def on_train_batch_end(self, *args: Any) -> None:
            self.bar.advance(self.task)

        def on_train_end(self, *args: Any) -> None:
            self.bar.stop()

        def on_exception(self, *args: Any) -> None:
            self.bar.stop()

    return Shown()


def section(found: dict[str, Any]) -> Section:
    """A row for each recipe."""
    rows = []
    for recipe, clock in found.items():
        rate = clock.operations / clock.seconds / 1e9
        rows.append(
            [
                Path(recipe).stem,
                clock.precision,
                f"{1000 * clock.seconds:.1f} ms",
                f"{clock.pairs / clock.seconds:.0f}",
                f"{100 * clock.waited / (clock.seconds + clock.waited):.1f} %",
                f"{clock.operations / 1e9:.0f}",
                f"{rate:.0f} GFLOP/s",
                f"{100 * rate / clock.machine:.0f} %",
            ]
        )
    header = [
        "recipe",
        "precision",
        "a step",
        "views a second",
        "waits for data",
        "GFLOP a step",
        "rate",
        "of matrices'",
    ]
    notes = [
        "Medians. Operations are those of convolutions and matrix products, forwards and backwards; the rate is over "
        "the whole step, and the last column its share of what products of 2048 × 2048 matrices reach in that "
        "precision, on a GPU of 8192 × 8192."
    ]
    return Section("Training", header, rows, notes)
