"""What `kfit bench speed` prints and writes: tables of ratios, and the page in Markdown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from statistics import median
from typing import Any

from kfit.bench.accuracy_page import Section

LIMITS = (5, 10, 30, 60)
Fits = Mapping[str, Mapping[str, Sequence[Mapping[str, Any]]]]


def sections(
    fits: Fits, timed: int, profiles: Mapping[str, Mapping[str, Any]], rates: Mapping[str, float]
) -> list[Section]:
    """The tables.

    Args:
        fits: by way and number of the view, what each repeat measured; the first way is what others are compared with.
        timed: views that were fitted repeatedly, the first ones.
        profiles: by way.
        rates: GFLOP a second of matrix products by precision.
    """
    found = [_cost(fits, timed)] if timed else []
    found.append(_quality(fits))
    if profiles:
        found.append(_profiles(profiles, rates))
    return found


def _cost(fits: Fits, timed: int) -> Section:
    names = list(fits)
    repeats = min(len(fits[name].get(str(number), [])) for name in names for number in range(timed))
    parts = {"s a view": ("seconds", ".2f"), "pictures": ("pictures", ".0f"), "MB at most": ("megabytes", ".0f")}
    rows = []
    for name in names:
        row = [name]
        for key, form in parts.values():
            own, first = (_medians(fits[which], key, timed, repeats) for which in (name, names[0]))
            if None in own or None in first:
                row += ["unknown", ""]
                continue
            row.append(format(median(own), form))
            row.append(f"{median(a / b for a, b in zip(first, own, strict=True)):.1f} ×")
        rows.append(row)
    header = ["way", *(word for part in parts for word in (part, "less"))]
    note = (
        f"Medians over {timed} views, fitted one by one, the ways in turn; ratios to the first row are of these "
        f"medians, the median of the repeats, of which there are {repeats}."
    )
    return Section("What a view costs", header, rows, [note])


def _medians(views: Mapping[str, Sequence[Mapping[str, Any]]], key: str, timed: int, repeats: int) -> list[Any]:
    """The median over the timed views, for each repeat."""
    found: list[Any] = []
    for repeat in range(repeats):
        values = [views[str(number)][repeat][key] for number in range(timed)]
        found.append(None if None in values else median(values))
    return found


def _quality(fits: Fits) -> Section:
    names = list(fits)
    common = [number for number in fits[names[0]] if all(number in fits[name] for name in names)]
    energies = [key for key in fits[names[0]][common[0]][0] if key.startswith("energy: ")]
    rows = []
    firsts = [fits[names[0]][number][0] for number in common]
    for name in names:
        views = [fits[name][number][0] for number in common]
        errors = [view["rotation_deg"] for view in views]
        row = [name, f"{median(errors):.1f}°"]
        row += [f"{100 * sum(error < limit for error in errors) / len(errors):.0f} %" for limit in LIMITS]
        row += [_energy(views, firsts, key) if key in views[0] else "" for key in energies]
        rows.append(row)
    header = ["way", "rotation error", *(f"< {limit}°" for limit in LIMITS)]
    header += [f"energy of “{key.removeprefix('energy: ')}”" for key in energies]
    notes = [
        f"{len(common)} views, medians. Energies are those at the answers, of the terms and weights of one way; in "
        f"brackets on how many views it is no higher than at the answer of “{names[0]}”."
    ]
    return Section("What it finds", header, rows, notes)


def _energy(views: Sequence[Mapping[str, Any]], firsts: Sequence[Mapping[str, Any]], key: str) -> str:
    lower = sum(view[key] <= first[key] for view, first in zip(views, firsts, strict=True))
    return f"{median(view[key] for view in views):.3g} ({lower})"


def _profiles(profiles: Mapping[str, Mapping[str, Any]], rates: Mapping[str, float]) -> Section:
    kinds = list(next(iter(profiles.values()))["shares"])
    rows = []
    for name, found in profiles.items():
        rate, most = found["gflop_per_second"], rates[found["precision"]]
        row = [name, f"{found['seconds']:.1f} s", *(f"{100 * found['shares'][kind]:.0f} %" for kind in kinds)]
        rows.append([*row, f"{found['gflop']:.0f}", f"{rate:.0f} GFLOP/s", f"{100 * rate / most:.0f} %"])
    header = ["way", "in all operators", *kinds, "GFLOP", "rate of products", "of the machine's"]
    reached = ", ".join(f"{rate:.0f} GFLOP/s in {_precision(name)}" for name, rate in rates.items())
    notes = [
        "One fit under PyTorch's profiler, of the first row two steps. The rate is that of convolutions and matrix "
        f"products, with the copies around them; products of 2048 × 2048 matrices reach {reached}."
    ]
    return Section("Where the time goes", header, rows, notes)


def _precision(name: str) -> str:
    return {"32": "single precision", "bf16": "bfloat16"}[name]


def page(tables: Sequence[Section], how: Mapping[str, Any]) -> str:
    """The page in Markdown."""
    versions = ", ".join(f"{name} {version}" for name, version in how["versions"].items())
    machine = how["machine"]
    lines = [
        "# What a fit costs",
        "",
        f"Made by `{how['command']}`, seed {how['seed']}; {versions}; {machine['processor']}, {machine['threads']} "
        f"threads of {machine['cores']} cores, device {how['device']}, kfit's own fits in "
        f"{_precision(how['precision'])}.",
        "",
    ]
    return "\n".join([*lines, *(line for table in tables for line in table.markdown())])
