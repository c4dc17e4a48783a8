"""The released schedule and kfit's side by side: seconds, pictures drawn, memory, energy and rotation error."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jsonargparse import ArgumentParser, Namespace

from kfit.bench.accuracy import command, write_text
from kfit.bench.page import show
from kfit.bench.speed_page import page, sections
from kfit.runtime.console import log, progress

if TYPE_CHECKING:
    from kfit.bench.held_out_views import HeldOutViews
    from kfit.fitting.pipeline import FitPipeline
    from kfit.pose import CategoryModel

FILE = "speed.json"
# Weight of the released picture energy relative to kfit's priors, as the code prior's 0.02 to the released 1.
RELEASED_WEIGHT = 0.02
DONE = "fits"


def parser() -> ArgumentParser:
    """Arguments of ``kfit bench speed``."""
    parser = ArgumentParser(
        description="Fit the same unseen views one by one: by the released code's schedule, by kfit's with the "
        "released energy of the picture, and by kfit's own fit, all with the weights of --model, and by kfit's own fit "
        "with the bundled model of the category. The first --timed views are fitted --repeats times, the ways in turn; "
        "all --views once for accuracy. The released schedule takes minutes a view on a CPU: with --out what was "
        "measured is kept after each fit, and the same command goes on after an interruption.",
        epilog="example:\n  kfit bench speed --model paper.safetensors --vgg16 vgg16-397923af.pth --out speed",
    )
    parser.add_argument(
        "--model",
        type=str,
        required=True,
        metavar="FILE.safetensors",
        help="paper-sized weights: recipes/vae3d_paper.yaml, then `kfit pack`",
    )
    parser.add_argument(
        "--recipe", type=str, default="recipes/fit_released.yaml", metavar="RECIPE.yaml", help="the released schedule"
    )
    parser.add_argument(
        "--vgg16",
        type=str,
        default=None,
        metavar="FILE",
        help="torchvision's VGG16 weights, in whose layers up to conv3_3 only the numbers differ from VGG19's "
        "(default: VGG19's file, as the recipe says: 548 MB, fetched the first time)",
    )
    parser.add_argument("--views", type=int, default=100, help="unseen objects, a view each, for accuracy")
    parser.add_argument("--timed", type=int, default=10, help="those of them that are timed")
    parser.add_argument("--repeats", type=int, default=3, help="fits of each timed view")
    parser.add_argument("--device", type=str, default="cpu", help="cpu, cuda or whatever PyTorch calls it")
    parser.add_argument("--precision", type=str, default="32", choices=["32", "bf16"], help="of kfit's own fits")
    parser.add_argument("--seed", type=int, default=0, help="chooses objects, poses and starts")
    parser.add_argument(
        "--out", type=str, default=None, metavar="DIR", help=f"write README.md and {FILE} there (default: nowhere)"
    )
    return parser


@dataclass(frozen=True)
class Way:
    """One way to fit, and its precision; the energies of ways with ``objective`` compare all ways' answers.

    What is profiled is ``short`` where that is given, a fit of fewer steps.
    """

    name: str
    model: CategoryModel
    pipeline: FitPipeline
    precision: str = "32"
    objective: bool = False
    short: FitPipeline | None = None


def run(args: Namespace) -> None:
    """Measure what was not measured yet, print the tables, and write them where they are wanted."""
    for name, least in {"views": 1, "timed": 0, "repeats": 1}.items():
        if args[name] < least:
            raise ValueError(f"--{name} must be at least {least}, got {args[name]}")
    if args.timed > args.views:
        raise ValueError(f"--timed must be at most --views, {args.views}, got {args.timed}")

    from kfit.bench.accuracy_page import circumstances
    from kfit.bench.held_out_views import held_out_views
    from kfit.models import load
    from kfit.runtime.atomic_write import atomic_write
    from kfit.runtime.devices import device_of, matrix_rate

    device = device_of(args.device)
    model = load(args.model).to(device)
    ways = ways_of(args, model)
    asked = {name: value for name, value in args.items() if name not in ("out", "views", "timed", "repeats")}
    found = _before(args.out, asked)
    with progress() as bar:
        task = bar.add_task("drawing views", total=args.views)
        views = held_out_views(model, args.views, args.seed, on_view=lambda done: bar.update(task, completed=done))
        left = [unit for unit in units(args, ways) if not _has(found, *unit)]
        bar.reset(task, total=len(left))
        for way, number, _ in left:
            bar.update(task, description=f"{way.name}, view {number + 1}")
            measured = fit(way, ways, views, number, args.seed, device)
            found[DONE].setdefault(way.name, {}).setdefault(str(number), []).append(measured)
            _keep(args.out, asked, found)
            bar.advance(task)
        if "profiles" not in found and device.type == "cpu":
            bar.update(task, description="profiles")
            found["profiles"] = profiles(ways, views)
            _keep(args.out, asked, found)
    import torch

    rates = {name: matrix_rate(dtype, device) for name, dtype in (("32", torch.float32), ("bf16", torch.bfloat16))}
    tables = sections(found[DONE], args.timed, found.get("profiles", {}), rates)
    show(tables, 140)
    if args.out:
        how = circumstances(command("speed", args, parser().get_defaults()), asked)
        for path in atomic_write(Path(args.out), {"README.md": partial(write_text, text=page(tables, how))}):
            log.info("wrote %s", path)


def ways_of(args: Namespace, model: CategoryModel) -> list[Way]:
    """The released schedule, kfit's, and kfit's with the bundled model where there is one."""
    from kfit.core import Energy
    from kfit.models import bundled, load
    from kfit.pose.fit_recipe import fit_of

    changes: list[str] = []
    if args.vgg16 is not None:
        network = "--energies.perceptual.init_args.network"
        changes = [network, "kfit.features.VGG16", f"{network}.init_args.layers", "[conv3_3]"]
        changes += [f"{network}.init_args.weights", args.vgg16]
    released = fit_of(args.recipe, model, changes)
    short = fit_of(args.recipe, model, [*changes, "--num_steps", "2"])
    parts = released.energies.items()
    energies = {name: (energy, RELEASED_WEIGHT) for name, energy in parts if isinstance(energy, Energy)}
    ways = [
        Way("released", model, released, objective=True, short=short),
        Way("kfit, released energy", model, model.pipeline(energies=energies), args.precision),
        Way("kfit", model, model.pipeline(), args.precision, objective=True),
    ]
    if model.card.category in bundled():
        compact = load(model.card.category).to(model.device)
        ways.append(Way("kfit, bundled model", compact, compact.pipeline(), args.precision))
    return ways


def units(args: Namespace, ways: list[Way]) -> Iterator[tuple[Way, int, int]]:
    """Return every requested fit: repeats of the timed views, the ways in turn, then the other views."""
    for repeat in range(args.repeats):
        yield from ((way, number, repeat) for number in range(args.timed) for way in ways)
    yield from ((way, number, 0) for number in range(args.timed, args.views) for way in ways)


def fit(
    way: Way, ways: list[Way], views: HeldOutViews, number: int, seed: int, device: Any
) -> dict[str, float | int | None]:
    """One view's fit: what it took, and how good it is by each way's energy of the same model and by the truth."""
    from kfit.bench.fit_cost import energy_at, timed
    from kfit.geometry import rotation_error
    from kfit.geometry.pose import rotation_of
    from kfit.runtime.devices import precision

    observation = views.observation[number].map(lambda tensor: tensor.to(device))
    with precision(way.precision, device):
        result, cost = timed(way.pipeline, observation, seed)
    symmetry = way.model.card.known.symmetry if views.visible[number] else "y"
    fitted = rotation_of({name: value.double().cpu() for name, value in result.values.items()})
    away = rotation_error(fitted, views.rotation[number : number + 1], symmetry)
    energies = {
        f"energy: {other.name}": float(energy_at(other.pipeline, observation, result))
        for other in ways
        if other.objective and other.model is way.model
    }
    return {**vars(cost), "rotation_deg": float(away.rad2deg()), **energies}


def profiles(ways: list[Way], views: HeldOutViews) -> dict[str, Any]:
    """Where the time of one fit of each way goes; of the released schedule's first two steps."""
    from kfit.bench.fit_cost import profile
    from kfit.runtime.devices import precision

    found = {}
    for way in ways:
        with precision(way.precision, "cpu"):
            found[way.name] = {**profile(way.short or way.pipeline, views.observation[0]), "precision": way.precision}
    return found


def _has(found: dict[str, Any], way: Way, number: int, repeat: int) -> bool:
    return len(found[DONE].get(way.name, {}).get(str(number), [])) > repeat


def _before(out: str | None, asked: dict[str, Any]) -> dict[str, Any]:
    """What the same command has measured already."""
    path = Path(out or "") / FILE
    if out is None or not path.is_file():
        return {DONE: {}}
    saved = json.loads(path.read_text(encoding="utf-8"))
    if saved["asked"] != json.loads(json.dumps(asked)):
        raise ValueError(f"{path} was measured with other settings; pass another --out, or delete it")
    kept: dict[str, Any] = saved["found"]
    return kept


def _keep(out: str | None, asked: dict[str, Any], found: dict[str, Any]) -> None:
    from kfit.runtime.atomic_write import atomic_write

    if out:
        text = json.dumps({"asked": asked, "found": found}, indent=1) + "\n"
        writers: dict[str, Callable[[Path], object]] = {FILE: partial(write_text, text=text)}
        atomic_write(Path(out), writers)
