"""Compare energies of drawing and photo: rotation errors of the same fits with each, and what a view costs."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jsonargparse import ArgumentParser, Namespace

from kfit.bench.accuracy import add_sources, check_sources, command, models_of, write_text
from kfit.bench.accuracy_page import Section, circumstances, mean_of, page
from kfit.runtime.console import log, progress, table_console

if TYPE_CHECKING:
    from kfit.bench.held_out_views import HeldOutViews
    from kfit.core import Energy
    from kfit.fitting.pipeline import FitPipeline
    from kfit.pose import CategoryModel

Mix = dict[str, "tuple[Energy, float]"]
SOURCES = ("procedural", "scans", "objects")
FILE = "energies.json"


def parser() -> ArgumentParser:
    """Arguments of ``kfit bench energies``."""
    parser = ArgumentParser(
        description="Fit the same views with each energy of drawing and photo, priors as always, and compare rotation "
        "errors. With --out, what was measured is kept there after each energy, and the same command goes on after an "
        "interruption.",
        epilog="example:\n  kfit bench energies --categories '[laptop,mug]' --nocs nocs --out energies",
    )
    add_sources(parser, 50)
    fit = parser.add_argument_group("fits")
    fit.add_argument("--starts", type=int, default=4, help="starts a view, best of 4 times as many; 16 if headless")
    fit.add_argument("--steps", type=int, default=16, help="steps of the optimizer")
    fit.add_argument(
        "--vgg16",
        type=str,
        default=None,
        metavar="FILE",
        help="torchvision's VGG16 weights, .pth or .safetensors, for the paper's energy and LPIPS (default: without)",
    )
    output = parser.add_argument_group("output")
    output.add_argument(
        "--out", type=str, default=None, metavar="DIR", help=f"write README.md and {FILE} there (default: nowhere)"
    )
    return parser


def mixes(vgg16: str | None) -> dict[str, Callable[[CategoryModel], Mix]]:
    """Energies by what tables call them.

    Weights bring each picture's energy to where EfficientNet's stands at the starts of fits of unseen mugs.
    """
    from kfit.energies import LPIPS, Perceptual
    from kfit.features import VGG16, Activations
    from kfit.pose.defaults import default_energies

    default = default_energies()

    def efficient(model: CategoryModel) -> Mix:
        return {"perceptual": default["perceptual"]}

    def ssim(model: CategoryModel) -> Mix:
        return {"ssim": default["ssim"]}

    def silhouette(model: CategoryModel) -> Mix:
        return {"silhouette": default["silhouette"]}

    def encoder(model: CategoryModel) -> Mix:
        reduced = [name for name, _ in model.encoder.named_modules() if name.startswith("reduce.")]
        activations = Activations(model.encoder, reduced, mean=(0.0, 0.0, 0.0), std=(1.0, 1.0, 1.0))
        return {"encoder": (Perceptual(activations), 0.75)}

    def vgg(model: CategoryModel) -> Mix:
        return {"perceptual": (Perceptual(VGG16(weights=vgg16), normalize=True), 0.65)}

    def lpips(model: CategoryModel) -> Mix:
        return {"lpips": (LPIPS("vgg", vgg16), 1.7)}

    def together(*parts: Callable[[CategoryModel], Mix]) -> Callable[[CategoryModel], Mix]:
        return lambda model: {name: energy for part in parts for name, energy in part(model).items()}

    found = {
        "EfficientNet": efficient,
        "SSIM": ssim,
        "EfficientNet, silhouette": together(efficient, silhouette),
        "SSIM, silhouette": together(ssim, silhouette),
        "EfficientNet, SSIM, silhouette": lambda model: default,
        "kfit's encoder, SSIM, silhouette": together(encoder, ssim, silhouette),
    }
    if vgg16 is not None:
        found |= {
            "VGG16 (the paper's)": vgg,
            "VGG16, SSIM, silhouette": together(vgg, ssim, silhouette),
            "LPIPS": lpips,
            "LPIPS, silhouette": together(lpips, silhouette),
        }
    return found


def run(args: Namespace) -> None:
    """Measure what was not measured yet, print the table, and write it where it is wanted."""

    from kfit.runtime.atomic_write import atomic_write

    check_sources(args)
    models = models_of(args)
    compared = mixes(args.vgg16)
    asked = {name: value for name, value in args.items() if name not in ("out", "vgg16")}
    found = _measured_before(args.out, asked)
    if args.vgg16 is None:
        log.info("VGG16's energies and LPIPS are left out; pass --vgg16 FILE for them")
    with progress() as bar:
        views: dict[str, HeldOutViews] = {}
        for name, make in compared.items():
            if name not in found:
                found[name] = _measured(args, models, bar, make, views)
            if args.out:
                saved = {"asked": asked, "found": found}
                atomic_write(Path(args.out), {FILE: partial(write_text, text=json.dumps(saved, indent=2) + "\n")})
    table = section({name: found[name] for name in compared})
    table_console(140).print(table.table())
    if args.out:
        how = circumstances(command("energies", args, parser().get_defaults()), asked | {"pruned": True})
        text = page([table], how, [])
        for path in atomic_write(Path(args.out), {"README.md": partial(write_text, text=text)}):
            log.info("wrote %s", path)


def _measured(
    args: Namespace,
    models: dict[str, CategoryModel],
    bar: Any,
    make: Callable[[CategoryModel], Mix],
    views: dict[str, HeldOutViews],
) -> dict[str, Any]:
    from kfit.bench.accuracy_fits import AccuracyFits

    def pipeline(model: CategoryModel, depth: bool) -> FitPipeline:
        return model.pipeline(args.starts, args.steps, depth=depth, energies=make(model))

    fits = AccuracyFits(models, bar, pipeline, args, views=views)
    return {
        "procedural": fits.procedural() if args.views else {},
        "scans": fits.scans() if args.meshes else {},
        "objects": fits.objects(("RGB",)) if args.nocs else [],
    }


def _measured_before(out: str | None, asked: Mapping[str, Any]) -> dict[str, Any]:
    path = Path(out or "") / FILE
    if out is None or not path.is_file():
        return {}
    saved = json.loads(path.read_text(encoding="utf-8"))
    return saved["found"] if saved["asked"] == json.loads(json.dumps(asked)) else {}


def section(found: Mapping[str, Mapping[str, Any]]) -> Section:
    """A row for each energy: means over categories and scans, and medians over the objects of frames."""
    header = ["energy of drawing and photo"]
    first = next(iter(found.values()))
    for source in SOURCES[:2]:
        header += [f"{source}: median", "< 5°", "< 10°", "< 30°"] if first[source] else []
    header += ["frames: median", "< 10°", "< 20°"] if first["objects"] else []
    header += ["s a view"] if first["procedural"] else []
    rows = []
    for name, measured in found.items():
        row = [name]
        for source in SOURCES[:2]:
            if measured[source]:
                mean = mean_of(measured[source])
                row += [f"{mean['median']:.1f}°", *(f"{100 * mean[f'under_{limit}']:.0f} %" for limit in (5, 10, 30))]
        if measured["objects"]:
            errors = sorted(thing["RGB"]["rotation_deg"] for thing in measured["objects"])
            row += [f"{errors[len(errors) // 2]:.1f}°"]
            row += [f"{sum(error < limit for error in errors)} of {len(errors)}" for limit in (10, 20)]
        if measured["procedural"]:
            seconds = [part["seconds a view"] for part in measured["procedural"].values()]
            row.append(f"{sum(seconds) / len(seconds):.1f}")
        rows.append(row)
    return Section("Energies of drawing and photo", header, rows)
