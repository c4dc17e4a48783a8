"""Every shipped part shows its settings, and can be written as a recipe unless it holds a network or tensors."""

import copy
import inspect

import energy_parts
import pytest
import test_initializers
import test_optimizers
import test_selectors
from jsonargparse import ArgumentParser

from kfit.callbacks import Progress, Pruning, Stopping
from kfit.core import Callback, Energy, Initializer, Optimizer, Prior, Selector
from kfit.core.part import Part, Unwritable
from kfit.energies import LPIPS
from kfit.fitting.recipe import recipe_of

KINDS = [
    *((Energy | Prior, build) for builds in energy_parts.BUILD.values() for build in builds),
    *((Initializer, build) for builds in test_initializers.BUILD.values() for build in builds),
    *((Optimizer, build) for builds in test_optimizers.BUILD.values() for build, _ in builds),
    *((Selector, build) for builds in test_selectors.BUILD.values() for build in builds),
    *((Callback, build) for build in (Progress, lambda: Pruning({0: 4, 9: 2}), lambda: Stopping(0.01, 2))),
]


def in_recipes(part):
    """Not those of the tests, nor LPIPS on weights whose file is gone."""
    return type(part).__module__.startswith("kfit.") and not isinstance(part, LPIPS)


OWN = [(kind, build) for kind, build in KINDS if in_recipes(build())]


def holds_what_cannot_be_written(part):
    values = part.settings.values()
    return any(isinstance(v, Unwritable) or (isinstance(v, Part) and holds_what_cannot_be_written(v)) for v in values)


@pytest.mark.parametrize(("kind", "build"), OWN, ids=lambda value: "")
class TestAPart:
    def test_shows_each_setting_of_its_constructor(self, kind, build):
        part = build()
        shown = repr(part)
        assert shown.startswith(f"{type(part).__name__}(")
        for name, parameter in inspect.signature(type(part)).parameters.items():
            if parameter.kind in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD):
                continue
            assert f"{name}=" in shown or f"({name}): " in shown

    def test_is_read_again_from_what_is_written(self, kind, build):
        part = build()
        if holds_what_cannot_be_written(part):
            with pytest.raises(ValueError, match="a recipe cannot hold"):
                recipe_of("part", part)
            return
        written = recipe_of("part", part)
        parser = ArgumentParser(exit_on_error=False)
        parser.add_argument("--part", type=kind)
        again = parser.instantiate(parser.parse_object({"part": copy.deepcopy(written)})).part
        assert type(again) is type(part)
        assert recipe_of("part", again) == written
