"""Read a category given by name, as a small YAML file, or by the import path of one in Python."""

from __future__ import annotations

import difflib
import importlib
from pathlib import Path
from typing import Any

import yaml  # type: ignore[import-untyped]

from kfit.geometry import CATEGORIES, Category

LARGEST = 100_000


def read_category(category: str | Category) -> Category:
    """Find a category, and import the module that draws its objects.

    This runs code of the named modules, so use it for the user's input only; model cards are never read with it.

    Args:
        category: a category; a name of `kfit.geometry.CATEGORIES`; the path of a YAML file with the fields of
            `kfit.geometry.Category`; or the import path of a `kfit.geometry.Category` in a module, ``teapot.TEAPOT``.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: If the argument has another form.
        ImportError: If the module cannot be imported.

    Example:
        >>> from kfit.data import read_category
        >>> read_category("mug").symmetry
        'none'
    """
    if isinstance(category, Category):
        found = category
    elif category in CATEGORIES:
        return CATEGORIES[category]
    elif category.endswith((".yaml", ".yml")):
        found = _from_file(Path(category))
    else:
        found = _from_module(category)
    if found.shapes is not None:
        importlib.import_module(found.shapes)
    return found


def _from_file(path: Path) -> Category:
    if not path.is_file():
        raise FileNotFoundError(f"category must name a file, but there is no {path}")
    if path.stat().st_size > LARGEST:
        raise ValueError(f"category must name a small file, but {path} has {path.stat().st_size:,} bytes")
    try:
        values: Any = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError) as error:
        raise ValueError(f"{path} is no YAML file: {' '.join(str(error).split())}") from None
    if not isinstance(values, dict) or not all(isinstance(key, str) for key in values):
        raise ValueError(f"{path} must map the fields of a category to values, such as name and mean_diagonal")
    try:
        return Category.of_dict(values)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{path}: {error}") from None


def _from_module(path: str) -> Category:
    module, _, name = path.rpartition(".")
    if not module:
        here = [f"{path}.yaml"] if Path(f"{path}.yaml").is_file() else []
        near = here or difflib.get_close_matches(path, CATEGORIES, 1)
        meant = f"; did you mean {near[0]}?" if near else ""
        raise ValueError(
            f"category must be one of {', '.join(CATEGORIES)}, a .yaml file or an import path such as teapot.TEAPOT, "
            f"got {path!r}{meant}"
        )
    try:
        found = getattr(importlib.import_module(module), name, None)
    except ModuleNotFoundError as error:
        if error.name is None or not f"{module}.".startswith(f"{error.name}."):  # the module itself needs another
            raise
        raise ImportError(f"category {path}: {error}; its folder must be the working folder or on PYTHONPATH") from None
    if not isinstance(found, Category):
        raise ValueError(f"category must name a kfit.geometry.Category, but {path} is {type(found).__name__}")
    return found
