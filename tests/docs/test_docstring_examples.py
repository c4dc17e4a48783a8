"""Examples in docstrings run and print what they show, and every public class and function of these rooms has one."""

import doctest
import importlib
import inspect
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
# They run the detector, or all of a fit.
SLOW = ("kfit.models.find_poses", "kfit.pose.object_finder")
MODULES = [
    pytest.param(name, marks=pytest.mark.slow if name in SLOW else ())
    for file in sorted((ROOT / "kfit").rglob("*.py"))
    if ">>> " in file.read_text()
    for name in [".".join(file.relative_to(ROOT).with_suffix("").parts)]
]
# A fit makes them and hands them to parts: the examples of `Optimizer` and `FitResult` use them.
RECEIVED = {"Evaluate", "Evaluation", "GradientEvaluation", "History", "Linearization"}
RECEIVED |= {"PicturesEvaluation", "ResidualEvaluation"}
ROOMS = [
    "kfit",
    "kfit.callbacks",
    "kfit.core",
    "kfit.data",
    "kfit.energies",
    "kfit.features",
    "kfit.fitting",
    "kfit.generators",
    "kfit.geometry",
    "kfit.initializers",
    "kfit.metrics",
    "kfit.models",
    "kfit.optimizers",
    "kfit.pose",
    "kfit.registration",
    "kfit.selectors",
    "kfit.tracking",
]


@pytest.mark.parametrize("name", MODULES)
def test_examples_of_a_module_print_what_they_show(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    # Classes in examples are not parts of kfit, which other tests find by walking subclasses.
    found = doctest.testmod(importlib.import_module(name), optionflags=FLAGS, extraglobs={"__name__": "__main__"})
    assert found.attempted > 0
    assert found.failed == 0


@pytest.mark.parametrize("room", ROOMS)
def test_every_public_class_and_function_has_an_example(room):
    module = importlib.import_module(room)
    parts = {name: getattr(module, name) for name in module.__all__}
    documented = {
        name: part
        for name, part in parts.items()
        if (inspect.isclass(part) or inspect.isfunction(part)) and part.__module__.startswith("kfit")  # no type aliases
    }
    assert {name for name, part in documented.items() if ">>> " not in (part.__doc__ or "")} == RECEIVED & set(parts)
