"""Imports go one way: from core up to the command line, and no module imports itself through others."""

import ast
import subprocess
import sys
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import kfit

ROOT = Path(kfit.__file__).parent
# Rooms by height; those of one line do not import one another, but for the pairs below.
FLOORS = [
    {"core", "runtime"},
    {"geometry"},
    {"energies", "initializers", "optimizers", "selectors", "callbacks", "features", "generators"}
    | {"metrics", "data", "segmentation"},
    {"fitting"},
    {"baselines", "registration"},
    {"training", "pose"},
    {"models", "tracking", "reports"},
    {"batch"},
    {"bench"},
    {"app"},
    {"cli"},
    {"__main__"},
]
# Energies and encoders compare and read features.
SAME_FLOOR = {("energies", "features"), ("generators", "features")}
HEIGHT = {room: height for height, floor in enumerate(FLOORS) for room in floor}


def module_of(path, root=ROOT):
    parts = [root.name, *path.relative_to(root).with_suffix("").parts]
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_of(path): path for path in sorted(ROOT.rglob("*.py"))}


def imported(source, package):
    """Full names of everything that a module imports, at its head, inside functions and for type checkers alike."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            start = package.rsplit(".", node.level - 1)[0] if node.level else ""
            module = ".".join(filter(None, [start, node.module]))
            yield from (f"{module}.{alias.name}" for alias in node.names)


def home(name):
    """The module of kfit that an imported name comes from; None for what is not kfit's, and for its version."""
    parts = name.split(".")
    if parts[0] != "kfit" or parts[1:] == ["__version__"]:
        return None
    if len(parts) > 1 and parts[1] in kfit._HOMES:
        return kfit._HOMES[parts[1]]
    while ".".join(parts) not in MODULES and len(parts) > 2:
        parts.pop()
    return ".".join(parts)


def package_of(module, path):
    return module if path.name == "__init__.py" else module.rpartition(".")[0]


def against(room, source, package="kfit.room"):
    """Rooms that a module of this room imports against the direction."""
    found = {module.split(".")[1] for name in imported(source, package) if (module := home(name)) and "." in module}
    return {
        other
        for other in found - {room}
        if HEIGHT.get(other, len(FLOORS)) >= HEIGHT[room] and (room, other) not in SAME_FLOOR
    }


below = [(module, path) for module, path in MODULES.items() if module != "kfit"]


@pytest.mark.parametrize(("module", "path"), below, ids=[module for module, _ in below])
def test_a_module_imports_only_what_lies_below_it(module, path):
    room = module.split(".")[1]
    assert room in HEIGHT, f"give the new room {room!r} its floor in this test"
    wrong = against(room, path.read_text(), package_of(module, path))
    assert not wrong, f"{room} must not import {', '.join(sorted(wrong))}"


def test_no_module_imports_itself_through_others():
    graph = {
        module: {home(name) for name in imported(path.read_text(), package_of(module, path))} - {None, module}
        for module, path in MODULES.items()
        # A package offers what its modules hold, and kfit offers names of all rooms when they are asked for.
        if path.name != "__init__.py"
    }
    packages = {module for module, path in MODULES.items() if path.name == "__init__.py"}
    # Who imports a package from outside it imports all that its head imports.
    for module, path in MODULES.items():
        if module in packages and module != "kfit":
            graph[module] = {home(name) for name in imported(path.read_text(), module)} - {None, module}
    try:
        list(TopologicalSorter(graph).static_order())
    except CycleError as error:
        pytest.fail(" -> ".join(error.args[1]))


def test_a_circle_is_found():
    with pytest.raises(CycleError):
        list(TopologicalSorter({"a": {"b"}, "b": {"a"}}).static_order())


@pytest.mark.parametrize("path", sorted((ROOT / "core").glob("*.py")), ids=lambda path: path.name)
def test_core_imports_torch_alone(path):
    foreign = {name.partition(".")[0] for name in imported(path.read_text(), "kfit.core")}
    assert foreign - sys.stdlib_module_names <= {"torch", "kfit"}


@pytest.mark.parametrize(
    ("room", "line", "wrong"),
    [
        ("core", "from kfit.geometry.pose import to_opencv", {"geometry"}),
        ("core", "from kfit.runtime.devices import cores", {"runtime"}),
        ("generators", "import kfit.energies.pixel", {"energies"}),
        ("generators", "from kfit import energies", {"energies"}),
        ("generators", "def f():\n    from ..data import Mesh", {"data"}),
        ("generators", "if TYPE_CHECKING:\n    from kfit.pose import CategoryModel", {"pose"}),
        ("features", "from kfit.energies import L1", {"energies"}),
        ("energies", "from kfit.features import VGG16", set()),
        ("energies", "from kfit import Energy", set()),
        ("training", "from kfit import FitPipeline", set()),
        ("data", "from kfit import FitPipeline", {"fitting"}),
        ("fitting", "from kfit.training import RandomSimilarity", {"training"}),
        ("pose", "from kfit.models import load", {"models"}),
        ("models", "from kfit.reports import draw_overlay", {"reports"}),
        ("models", "from kfit import __version__", set()),
        ("bench", "from kfit.cli import pose", {"cli"}),
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


# Packages for training, files and reports, which other tasks do not use.
HEAVY = {"lightning", "h5py", "trimesh", "matplotlib", "onnxruntime", "scipy", "skimage", "cv2", "rich", "jsonargparse"}


def test_energies_optimizers_and_fits_load_no_heavy_package():
    code = "import sys, kfit.energies, kfit.optimizers, kfit.fitting.pipeline; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert {"kfit.energies.ssim", "torch"} <= set(loaded)
    assert not HEAVY & set(loaded)


def test_the_names_that_kfit_offers_are_there_and_no_others():
    assert kfit.FitPipeline.__module__ == "kfit.fitting.pipeline"
    assert {kfit.Generator.__module__, kfit.Energy.__module__} == {"kfit.core.generator", "kfit.core.energy"}
    assert all(getattr(kfit, name) is not None for name in kfit.__all__)
    assert callable(kfit.load)
    assert callable(kfit.report)
    assert set(kfit.__all__) <= set(dir(kfit))
    with pytest.raises(AttributeError, match="module 'kfit' has no attribute 'nonsense'"):
        kfit.nonsense  # noqa: B018
