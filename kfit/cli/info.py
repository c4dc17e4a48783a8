"""Show versions, devices, bundled models, caches and extras."""

from __future__ import annotations

import json
import math
import platform
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path
from typing import Any

from jsonargparse import ArgumentParser, Namespace

from kfit.bench.accuracy_page import Section, processor
from kfit.bench.page import show

PACKAGES = ("torch", "kornia", "opencv-contrib-python-headless", "onnxruntime", "lightning")
# As cards name them; earlier ones do not name the kind of views.
HELD_OUT, UPRIGHT, ALL = "unseen procedural objects, held-out families", ", upright views", "all views"
BUNDLED = Path(__file__).parents[1] / "models/bundled"
MIB = 2**20


def parser() -> ArgumentParser:
    """Arguments of ``kfit info``."""
    parser = ArgumentParser(
        description="Show what a bug report needs: versions, devices, bundled models with their rotation errors on "
        "upright views of unseen procedural objects, caches and optional packages.",
        epilog="examples:\n  kfit info\n  kfit info --json",
    )
    parser.add_argument("--json", action="store_true", help="print JSON instead of tables")
    return parser


def run(args: Namespace) -> None:
    """Look, and print."""
    facts = {part.__name__: part() for part in (versions, devices, models, caches, extras)}
    if args.json:
        print(json.dumps(facts, ensure_ascii=False))
    else:
        show(sections(facts), 100)


def versions() -> dict[str, str | None]:
    """Of kfit, of Python, and of the packages that do most of the work; None of one that is not there."""
    return {
        "kfit": _version("kfit"),
        "python": platform.python_version(),
        **{name: _version(name) for name in PACKAGES},
    }


def devices() -> list[dict[str, Any]]:
    """What ``--device`` may name here, and whether it computes bfloat16 itself; memory in MiB, None of the CPU."""
    import torch

    known: dict[str, Any] = getattr(torch.cpu, "get_capabilities", dict)()  # not available in older PyTorch
    fast = any(known[name] for name in known if name.endswith("bf16")) if known else None
    threads = torch.get_num_threads()
    found = [{"device": "cpu", "name": processor(), "threads": threads, "bfloat16": fast, "memory_mib": None}]
    for number in range(torch.cuda.device_count()):
        card = torch.cuda.get_device_properties(number)
        own = {"bfloat16": card.major >= 8, "memory_mib": card.total_memory // MIB}
        found.append({"device": f"cuda:{number}", "name": card.name, "threads": None, **own})
    if torch.backends.mps.is_available():
        found.append({"device": "mps", "name": "Apple GPU", "threads": None, "bfloat16": None, "memory_mib": None})
    return found


def models() -> list[dict[str, Any]]:
    """Return a summary of the cards of the bundled models."""
    from safetensors import safe_open

    from kfit.models import read_card

    found = []
    for path in sorted(BUNDLED.glob("*.safetensors")):
        card = read_card(path)
        with safe_open(path, "np") as file:
            shapes = [file.get_slice(name).get_shape() for name in file.keys()]  # noqa: SIM118
        measured = card.accuracy.get(HELD_OUT + UPRIGHT, card.accuracy.get(HELD_OUT, {})).get(ALL, {})
        found.append(
            {
                "category": card.category,
                "generator": card.networks["generator"]["class_path"],
                "parameters": sum(map(math.prod, shapes)),
                "symmetric": card.symmetry == "y",
                "calibrated": sorted(card.calibration),
                "median_rotation_error_deg": measured.get("median"),
                "under_10_deg": measured.get("under_10"),
            }
        )
    return found


def caches() -> list[dict[str, Any]]:
    """Return cache folders and their sizes in MiB; 0 if a folder does not exist."""
    import torch

    found = []
    for what, folder in (
        ("views that trainings rendered", Path(".kfit_cache")),
        ("weights fetched", torch.hub.get_dir()),
    ):
        size = sum(path.stat().st_size for path in Path(folder).rglob("*") if path.is_file())
        found.append({"folder": str(Path(folder).absolute()), "holds": what, "mib": round(size / MIB, 1)})
    return found


def extras() -> list[dict[str, Any]]:
    """kfit's optional parts: what each lacks, and how it is installed."""
    from packaging.requirements import Requirement

    about = metadata.metadata("kfit")
    needs = [Requirement(line) for line in about.get_all("Requires-Dist") or []]

    def packages(extra: str) -> Iterator[str]:
        for need in needs:
            if need.marker is not None and need.marker.evaluate({"extra": extra}):
                if need.name == "kfit":  # an extra that holds others
                    for other in need.extras:
                        yield from packages(other)
                else:
                    yield need.name

    found = []
    for extra in about.get_all("Provides-Extra") or []:
        lacks = sorted(name for name in set(packages(extra)) if _version(name) is None)
        found.append({"extra": extra, "installed": not lacks, "lacks": lacks, "by": f"pip install 'kfit[{extra}]'"})
    return found


def sections(facts: dict[str, Any]) -> list[Section]:
    """A table for each part."""

    def yes(value: bool | None) -> str:
        return {True: "yes", False: "no", None: "unknown"}[value]

    return [
        Section(
            "Versions", ["of", "version"], [[name, number or "missing"] for name, number in facts["versions"].items()]
        ),
        Section(
            "Devices",
            ["device", "name", "threads", "bfloat16", "memory"],
            [
                [
                    one["device"],
                    one["name"],
                    str(one["threads"] or ""),
                    yes(one["bfloat16"]),
                    f"{one['memory_mib'] / 1024:.0f} GiB" if one["memory_mib"] else "",
                ]
                for one in facts["devices"]
            ],
        ),
        Section(
            "Models",
            ["category", "parameters", "symmetric", "calibrated for", "median error", "< 10°"],
            [
                [
                    one["category"],
                    f"{one['parameters'] / 1e6:.1f} million",
                    yes(one["symmetric"]),
                    ", ".join(one["calibrated"]) or "nothing",
                    "" if (median := one["median_rotation_error_deg"]) is None else f"{median:.1f}°",
                    "" if (share := one["under_10_deg"]) is None else f"{100 * share:.0f} %",
                ]
                for one in facts["models"]
            ],
            ["Rotation errors on unseen procedural objects; symmetric objects are measured by their axis."],
        ),
        Section(
            "Caches",
            ["folder", "holds", "size"],
            [[c["folder"], c["holds"], f"{c['mib']:.1f} MiB"] for c in facts["caches"]],
        ),
        Section(
            "Extras",
            ["extra", "installed", "to install it"],
            [[one["extra"], yes(one["installed"]), "" if one["installed"] else one["by"]] for one in facts["extras"]],
        ),
    ]


def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None
