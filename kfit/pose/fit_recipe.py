"""Reading a fit from a YAML recipe, for any model."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from jsonargparse import ArgumentError, ArgumentParser

from kfit.fitting.pipeline import FitPipeline
from kfit.generators import SimilarityWarp, fixed_camera
from kfit.initializers import EncoderPosterior
from kfit.pose.category_model import CategoryModel
from kfit.runtime.class_paths import current_path, read_old_paths
from kfit.runtime.parse_errors import sentence
from kfit.runtime.recipe_limits import check_recipe, no_exit


def fit_of(recipe: str | Path, model: CategoryModel, changes: Sequence[str] = ()) -> FitPipeline:
    """Build the fit of a recipe for a model, on the model's device.

    A recipe names Python classes, whose modules are imported: use recipes, like programs, only from sources you trust.
    It holds the arguments of `kfit.FitPipeline` except the generator, each part by its ``class_path``; see
    ``recipes/fit_released.yaml``. The model provides the generator, in `kfit.generators.SimilarityWarp`, with a fixed
    distance if no initializer sets the ``focal``; its encoder's posterior, if no initializer sets the code; and its
    category's symmetry, for selectors that need one.

    Args:
        recipe: path of the YAML file.
        model: provides the generator.
        changes: arguments that change single entries, as on a command line: ``["--num_starts", "8"]``.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: if the recipe is not a fit of this model, in one sentence.
    """
    path = Path(recipe)
    if not path.is_file():
        raise FileNotFoundError(f"there is no recipe {path}")
    check_recipe(path)
    read_old_paths()
    parser = ArgumentParser(exit_on_error=False)
    parser.add_class_arguments(FitPipeline, skip={"generator"}, instantiate=False)
    parser.add_argument("--config", action="config")
    try:
        with no_exit():
            parsed = parser.parse_args(["--config", str(path), *map(current_path, changes)])
        if "selector.init_args.symmetry" in parsed:
            parsed["selector.init_args.symmetry"] = model.card.known.symmetry
        with no_exit():
            parts = parser.instantiate(parsed).as_dict()
        parts.pop("config")
        if all("code" not in initializer.on for initializer in parts["initializers"]):
            parts["initializers"] = [*parts["initializers"], EncoderPosterior(model.encoder)]
        distant = any("focal" in initializer.on for initializer in parts["initializers"])
        generator = model.generator if distant else fixed_camera(model.generator)
        return FitPipeline(SimilarityWarp(generator), **parts).to(model.device)
    except (ArgumentError, ValueError, TypeError, RecursionError) as error:
        message = sentence(str(error))
        reason = "it must map names to values" if message.startswith("Unexpected config") else message
        raise ValueError(f"{path} is no recipe of a fit: {reason}") from None
