"""Class paths and arguments of earlier versions: recipes, checkpoints and cards that name them are still read."""

from __future__ import annotations

import difflib
import importlib
import inspect
import re
import sys
from collections.abc import Iterable
from types import ModuleType
from typing import Any

import yaml  # type: ignore[import-untyped]
from jsonargparse import get_loader, set_loader

# Old name of a module or class → the new one.
MOVED = {
    "kfit.core.PoseNetwork": "kfit.geometry.PoseNetwork",
    "kfit.models.dataset_fit": "kfit.batch.dataset_fit",
    "kfit.models.fit_data": "kfit.batch.fit_data",
    "kfit.models.nocs_fit": "kfit.batch.nocs_fit",
    "kfit.models.photo_folder": "kfit.batch.photo_folder",
    "kfit.pipeline": "kfit.fitting.pipeline",
    "kfit.schedules": "kfit.fitting.schedules",
    "kfit.training.Disturb": "kfit.training.RandomCorruption",
    "kfit.training.Jitter": "kfit.training.RandomSimilarity",
    "kfit.training.Photograph": "kfit.training.PhotometricAugmentation",
    "kfit.training.Recolor": "kfit.training.RandomRecolor",
    "kfit.training.WholeCheckpoints": "kfit.training.AtomicCheckpoints",
    "kfit.training.disturb.Disturb": "kfit.training.RandomCorruption",
    "kfit.training.jitter.Jitter": "kfit.training.RandomSimilarity",
    "kfit.training.photograph.Photograph": "kfit.training.PhotometricAugmentation",
    "kfit.training.recolor.Recolor": "kfit.training.RandomRecolor",
    "kfit.training.whole_checkpoints.WholeCheckpoints": "kfit.training.AtomicCheckpoints",
}
# Old name of an argument → the new one, of the classes whose present import path begins so.
AUGMENTATIONS = {
    "disturb": "corruption",
    "jitter": "similarity",
    "photograph": "photometric",
    "recolor": "recoloring",
}
RENAMED = {
    "kfit.training.": AUGMENTATIONS,
    "kfit.generators.PoseHead": {"spread_deg": "sigma_deg"},
    "kfit.initializers.": {"spread": "sigma"},
    "kfit.optimizers.CMAES": {"spread": "sigma"},
}


def current_path(name: str) -> str:
    """Give the present import path of a class that an earlier version may have named otherwise.

    >>> current_path("kfit.schedules.Linear")
    'kfit.fitting.schedules.Linear'
    """
    module, _, kind = name.rpartition(".")
    if name in MOVED:
        return MOVED[name]
    return f"{MOVED[module]}.{kind}" if module in MOVED else name


def current_paths(value: Any) -> Any:
    """Replace old class paths, and old names of those classes' arguments, in a value of dicts, lists and strings."""
    if isinstance(value, str):
        return current_path(value)
    if isinstance(value, dict):
        present = {key: current_paths(one) for key, one in value.items()}
        if isinstance(arguments := present.get("init_args"), dict):
            renamed = _renamed(str(present.get("class_path")))
            present["init_args"] = {renamed.get(key, key): one for key, one in arguments.items()}
        return present
    return [current_paths(one) for one in value] if isinstance(value, list) else value


def near_class(text: str) -> str | None:
    """Import path of a class that a misspelt one in a text may have meant.

    >>> import kfit.generators
    >>> near_class("'kfit.generators.VEA3D' cannot be imported")
    'kfit.generators.VAE3D'

    Args:
        text: an error that names class paths, or classes by their name alone where jsonargparse expects a class.
    """
    for path in _PATH.findall(text):
        module, _, name = path.rpartition(".")
        if module not in sys.modules and module.partition(".")[0] != "kfit":
            continue
        try:
            found = importlib.import_module(module)
        except ImportError:
            continue
        if not hasattr(found, name) and (near := _near(name, _classes(found))):
            return f"{module}.{near}"
    known: dict[str, str] = {}
    for module, found in sorted(sys.modules.items()):
        if module == "lightning.pytorch.callbacks" or (module.startswith("kfit.") and module.count(".") == 1):
            known |= {name: f"{module}.{name}" for name in _classes(found)}
    for name in _NAME.findall(text):
        if name not in known and (near := _near(name, known)):
            return known[near]
    return None


def near_argument(text: str) -> str | None:
    """Argument of a class that a misspelt one in an error of jsonargparse may have meant.

    >>> import kfit.energies
    >>> near_argument("Problem with given class_path 'kfit.energies.Depth': Option 'enrgy' is not accepted")
    'energy'
    """
    if (found := _ARGUMENT.search(text)) is None:
        return None
    module, _, name = found[1].rpartition(".")
    kind = getattr(sys.modules.get(module), name, None)
    return None if kind is None else _near(found[2], inspect.signature(kind).parameters)


_ARGUMENT = re.compile(r"class_path '([\w.]+)':\s+Option '(\w+)' is not accepted")
_PATH = re.compile(r"[A-Za-z_]\w*(?:\.[A-Za-z_]\w*)+")
_NAME = re.compile(r"(?:class_path|dot import path string:)\W+(\w+)(?=['\"\s]|$)")


def _classes(module: ModuleType) -> list[str]:
    return [name for name, value in vars(module).items() if isinstance(value, type) and not name.startswith("_")]


def _near(name: str, known: Iterable[str]) -> str | None:
    by_lower = {one.lower(): one for one in known}
    found = difflib.get_close_matches(name.lower(), by_lower, 1, 0.7)
    return by_lower[found[0]] if found else None


def current_word(word: str) -> str:
    """Replace an old class path in a word of a training's command line, or the old name of one of its arguments.

    >>> current_word("--model.jitter.roll_deg=5")
    '--model.similarity.roll_deg=5'
    """
    head, dot, rest = word.partition(".")
    if head != "--model" or not dot:
        return current_path(word)
    name, end = re.match(r"(?:init_args\.)?(\w*)(.*)", rest, re.DOTALL).groups()  # type: ignore[union-attr]
    return f"--model.{AUGMENTATIONS.get(name, name)}{end}"


def _renamed(path: str) -> dict[str, str]:
    return next((names for begin, names in RENAMED.items() if path.startswith(begin)), {})


def read_old_paths() -> None:
    """Have jsonargparse's parsers understand old class paths in the YAML that they read, in this process.

    They also take the keys ``on`` and ``off`` for names, which YAML 1.1 takes for true and false.
    """
    load = get_loader("yaml")
    if load is not _load:
        _loaders[:] = [load]
        set_loader("yaml", _load, exceptions=(yaml.YAMLError,))


_loaders: list[Any] = []


def _load(text: str) -> Any:
    return current_paths(_with_names(_loaders[0](text)))


def _with_names(value: Any) -> Any:
    """Replace keys that are true or false by names, at any depth."""
    if isinstance(value, dict):
        names = {True: "on", False: "off"}
        return {names[key] if isinstance(key, bool) else key: _with_names(one) for key, one in value.items()}
    return [_with_names(one) for one in value] if isinstance(value, list) else value
