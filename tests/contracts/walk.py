"""Finds the shipped parts of a kind."""

import importlib
import pkgutil


def shipped(room, kind):
    """The public classes of a package that answer a contract, by name."""
    for module in pkgutil.iter_modules(room.__path__, f"{room.__name__}."):
        importlib.import_module(module.name)
    found, todo = set(), [kind]
    while todo:
        todo += (subclasses := todo.pop().__subclasses__())
        found |= {s for s in subclasses if s.__module__.startswith(f"{room.__name__}.") and s.__name__[0] != "_"}
    return {s for s in found if not s.__abstractmethods__}
