"""Imports go one way: core and geometry, the parts, the pipeline, training, models and reports, the command line."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import kfit

ROOT = Path(kfit.__file__).parent
PARTS = {
    "energies", "initializers", "optimizers", "selectors", "callbacks", "features", "generators",
    "metrics", "data", "segmentation", "schedules",
}  # fmt: skip
BELOW_PARTS = {"core", "geometry"}
BELOW_MODELS = BELOW_PARTS | PARTS | {"baselines", "devices", "judge", "mistakes", "pipeline", "training"}
# What each room may import of the others.
ALLOWED = {
    "core": set(),
    "geometry": {"core"},
    **{part: BELOW_PARTS for part in PARTS},
    "data": BELOW_PARTS | {"devices"},
    "energies": BELOW_PARTS | {"features"},
    "generators": BELOW_PARTS | {"features"},  # the encoders beside them
    # Whole methods, not parts of one: they share VGG16 with the features and NOCS's alignment with the data's readers.
    "baselines": BELOW_PARTS | {"features", "data"},
    "devices": set(),
    "judge": BELOW_PARTS,
    "mistakes": set(),
    "proposals": BELOW_PARTS,
    "pipeline": BELOW_PARTS | PARTS | {"devices", "judge", "proposals"},
    "training": BELOW_PARTS | PARTS | {"baselines", "devices", "pipeline"},
    "models": BELOW_MODELS,
    "reports": BELOW_MODELS | {"models"},  # pages of what models answer
    "app": BELOW_MODELS | {"models", "reports"},
    "cli": BELOW_MODELS | {"models", "reports", "app"},
    "__main__": {"cli"},
    "__init__": {"pipeline", "models", "reports"},  # names them lazily
}


def room_of(path):
    return path.relative_to(ROOT).parts[0].removesuffix(".py")


def imported(source, package):
    """Full names of everything that a module imports, at its head, inside functions and for type checkers alike."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            start = package.rsplit(".", node.level - 1)[0] if node.level else ""
            module = ".".join(filter(None, [start, node.module]))
            yield from (f"{module}.{alias.name}" for alias in node.names)


def rooms(names):
    """Rooms of kfit among imported names; what `kfit` itself offers counts as the room that it comes from."""
    for name in names:
        top, _, rest = name.partition(".")
        if top == "kfit" and rest != "__version__":
            first = rest.partition(".")[0]
            yield kfit._HOMES[first].split(".")[1] if first in kfit._HOMES else first


def against(room, source, package="kfit.room"):
    return {other for other in rooms(imported(source, package)) if other != room} - ALLOWED[room]


modules = sorted(ROOT.rglob("*.py"))


@pytest.mark.parametrize("path", modules, ids=lambda path: str(path.relative_to(ROOT)))
def test_a_module_imports_only_what_lies_below_it(path):
    room, package = room_of(path), ".".join(["kfit", *path.relative_to(ROOT).parts[:-1]])
    assert room in ALLOWED, f"say in this test what the new room {room!r} may import"
    wrong = against(room, path.read_text(), package)
    assert not wrong, f"{room} must not import {', '.join(sorted(wrong))}"


@pytest.mark.parametrize("path", sorted((ROOT / "core").glob("*.py")), ids=lambda path: path.name)
def test_core_imports_torch_alone(path):
    foreign = {name.partition(".")[0] for name in imported(path.read_text(), "kfit.core")}
    assert foreign - sys.stdlib_module_names <= {"torch", "kfit"}


@pytest.mark.parametrize(
    ("room", "line", "wrong"),
    [
        ("core", "from kfit.geometry.pose import to_opencv", {"geometry"}),
        ("generators", "import kfit.energies.pixel", {"energies"}),
        ("generators", "from kfit import energies", {"energies"}),
        ("generators", "def f():\n    from ..data import Mesh", {"data"}),
        ("features", "from kfit.energies import L1", {"energies"}),
        ("energies", "from kfit.features import VGG16", set()),
        ("training", "from kfit import FitPipeline", set()),
        ("data", "from kfit import FitPipeline", {"pipeline"}),
        ("pipeline", "from kfit.training import Jitter", {"training"}),
        ("models", "from kfit.reports import draw_overlay", {"reports"}),
        ("models", "from kfit import __version__", set()),
        ("models", "import torch, kfitting.cli", set()),
    ],
)
def test_an_import_that_runs_the_other_way_is_found(room, line, wrong):
    assert against(room, line, f"kfit.{room}") == wrong


def test_importing_kfit_loads_neither_torch_nor_any_part():
    code = (
        "import sys, kfit; kfit.__version__; dir(kfit); "
        "print(*sorted(n for n in sys.modules if n.split('.')[0] in ('torch', 'numpy', 'kfit')))"
    )
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert loaded == ["kfit"]


def test_the_names_that_kfit_offers_are_there_and_no_others():
    assert kfit.FitPipeline.__module__ == "kfit.fitting.pipeline"
    assert callable(kfit.load)
    assert callable(kfit.report)
    assert set(kfit.__all__) <= set(dir(kfit))
    with pytest.raises(AttributeError, match="module 'kfit' has no attribute 'nonsense'"):
        kfit.nonsense  # noqa: B018
