"""What `kfit bench accuracy` prints and writes: tables, the page in Markdown, and how it was made."""

from __future__ import annotations

import os
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.table import Table

LIMITS = (5, 10, 30, 60)
SHARES = [f"under_{limit}" for limit in LIMITS]
HEADER = ["of", "number", "median", *(f"< {limit}°" for limit in LIMITS), "translation", "a view"]


@dataclass(frozen=True)
class Section:
    """A table with a heading, and sentences below it."""

    heading: str
    header: list[str]
    rows: list[list[str]]
    notes: Sequence[str] = ()

    def table(self) -> Table:
        """For the terminal."""
        from rich.table import Column, Table

        table = Table(*(Column(name, overflow="fold") for name in self.header), title=self.heading)
        for row in self.rows:
            table.add_row(*row)
        return table

    def markdown(self) -> list[str]:
        """Lines of the page."""
        lines = [f"## {self.heading}", "", _line(self.header), _line(["---"] * len(self.header))]
        return [*lines, *map(_line, self.rows), "", *(part for note in self.notes for part in (note, ""))]


def views_section(heading: str, figures: Mapping[str, Mapping[str, Any]]) -> Section:
    """A row for each name, for what of it shows its handle, and for their mean.

    Args:
        heading: above the table.
        figures: by name, what `kfit.bench.pose_errors.PoseErrors.figures` gives.
    """
    rows, notes = [], []
    for name, found in figures.items():
        rows.append(_row(name, found["all views"], found))
        shown = found.get("views that show the handle")
        if shown:
            rows.append(_row(f"{name}, handle shown", shown, {}))
        called = [
            f"{100 * group['called ambiguous']:.0f} % of {group['number']} {which}"
            for which, group in found["called ambiguous"].items()
        ]
        notes.append(
            f"{name}: called ambiguous: {', '.join(called) or 'none'}; {found['pictures a view']:.0f} pictures drawn "
            f"and {found['seconds a view']:.2f} s a view."
        )
    if len(figures) > 1:
        rows.append(_row("mean", mean_of(figures), {}))
    return Section(heading, HEADER, rows, notes)


def mean_of(figures: Mapping[str, Mapping[str, Any]]) -> dict[str, float]:
    """Means over the names of median and shares, and the number of all views."""
    parts = [found["all views"] for found in figures.values()]
    mean = {key: sum(part[key] for part in parts) / len(parts) for key in ("median", *SHARES)}
    return {"number": sum(part["number"] for part in parts), **mean}


def _row(name: str, shares: Mapping[str, Any], found: Mapping[str, Any]) -> list[str]:
    away = found.get("median translation error in cm")
    seconds = found.get("seconds a view")
    return [
        name,
        str(shares["number"]),
        f"{shares['median']:.1f}°",
        *(f"{100 * shares[key]:.0f} %" for key in SHARES),
        "" if away is None else f"{away:.1f} cm",
        "" if seconds is None else f"{seconds:.1f} s",
    ]


def objects_section(objects: Sequence[Mapping[str, Any]]) -> Section:
    """A row for each object of NOCS's frames, and for each part of the data how many of those fitted are near."""
    ways = ("RGB", "RGB-D")
    rows = [[thing["name"], thing["category"], *(_pair(thing[way]) for way in ways)] for thing in objects]
    notes = []
    for split in dict.fromkeys(thing["split"] for thing in objects):
        part = [thing for thing in objects if thing["split"] == split]
        for way in ways:
            pairs = [thing[way] for thing in part if thing[way] is not None]
            if not pairs:
                continue
            near = [sum(pair["rotation_deg"] < limit for pair in pairs) for limit in (10, 20)]
            close = sum(pair["translation_cm"] < 3 for pair in pairs)
            notes.append(
                f"{split}, {way}: of {len(pairs)} objects {near[0]} within 10°, {near[1]} within 20°, "
                f"{close} within 3 cm."
            )
    return Section("Objects of NOCS's frames, true masks", ["object", "category", *ways], rows, notes)


def _pair(found: Mapping[str, float] | None) -> str:
    return "no depth" if found is None else f"{found['rotation_deg']:.1f}°, {found['translation_cm']:.1f} cm"


def circumstances(command: str, settings: Mapping[str, Any]) -> dict[str, Any]:
    """What the figures rest on: the command, its settings, versions and the machine."""
    import cv2
    import torch

    from kfit import __version__

    named = processor() + (f" with {torch.cuda.get_device_name()}" if torch.cuda.is_available() else "")
    return {
        "command": command,
        **settings,
        "versions": {"kfit": __version__, "torch": torch.__version__, "opencv": cv2.__version__}
        | {"python": platform.python_version()},
        "machine": {"processor": named, "cores": os.cpu_count(), "threads": torch.get_num_threads()},
    }


def processor() -> str:
    """Return the processor's name, which Python knows on some systems only."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    named = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return named[0] if named else platform.processor() or platform.machine()


def page(sections: Sequence[Section], how: Mapping[str, Any], sheets: Sequence[str]) -> str:
    """Return the page in Markdown, with links to the sheets in its folder."""
    versions = ", ".join(f"{name} {version}" for name, version in how["versions"].items())
    machine, seed = how["machine"], how["seed"]
    lines = [
        "# How accurate the models are",
        "",
        f"Made by `{how['command']}`: {how['starts']} starts and {how['steps']} steps a fit, "
        f"{'pruned' if how['pruned'] else 'not pruned'}, seed {seed}; {versions}; {machine['processor']}, "
        f"{machine['threads']} threads of {machine['cores']} cores. Symmetric classes, and mugs whose handle is "
        "hidden, are measured by their axis, as NOCS does. The last row of a table of views is the mean of its rows.",
        "",
    ]
    for section in sections:
        lines += section.markdown()
    for name in sheets:
        lines += [f"![{Path(name).stem.replace('_', ' ')}]({name})", ""]
    return "\n".join(lines)


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"
