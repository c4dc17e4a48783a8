"""Draws the plots of docs/results/README.md from the tables of its neighbours: python docs/drawings/results.py."""

from __future__ import annotations

import math
import re
from pathlib import Path

RESULTS = Path(__file__).parents[1] / "results"
INK, PALE, ORANGE, BLUE, PAPER = "#2b2f36", "#b9c0cc", "#d9730d", "#2f6fde", "#fcfcfd"
WIDTH = 720


def table(page: str, head: str) -> dict[str, list[str]]:
    """Rows of the first table on a page whose head begins so, by their first cell."""
    rows: dict[str, list[str]] = {}
    for line in (RESULTS / page).read_text(encoding="utf-8").partition(head)[2].splitlines()[2:]:
        if not line.startswith("|"):
            break
        name, *cells = (cell.strip() for cell in line.strip("|").split("|"))
        rows[name] = cells
    return rows


def number(cell: str) -> float:
    """The number at a cell's beginning."""
    found = re.match(r"[\d.]+", cell)
    assert found is not None, cell
    return float(found[0])


def text(x: float, y: float, words: str, anchor: str = "middle", size: int = 13) -> str:
    """A line of letters."""
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" font-size="{size}" fill="{INK}">{words}</text>'


def bar(x: float, y: float, width: float, height: float, color: str) -> str:
    """A bar with its lower left or upper left corner at (x, y)."""
    return f'<rect x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}" fill="{color}"/>'


def save(name: str, height: int, alt: str, parts: list[str]) -> None:
    """Write an SVG file."""
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" role="img" aria-label="{alt}" '
    head += 'font-family="system-ui, sans-serif">'
    body = "\n".join([head, f'<rect width="{WIDTH}" height="{height}" fill="{PAPER}"/>', *parts, "</svg>"])
    (RESULTS / f"{name}.svg").write_text(body + "\n", encoding="utf-8")


def accuracy() -> None:
    """Shares of answers within 5°, 10° and 30°, in groups of three upright bars."""
    rows = table("accuracy/README.md", "| of | number | median | < 5° | < 10° | < 30°")
    names, parts = ["bottle", "bowl", "camera", "can", "laptop", "mug"], []
    kinds = (("within 5°", 2, BLUE), ("within 10°", 3, ORANGE), ("within 30°", 4, PALE))
    for k, (label, _, color) in enumerate(kinds):
        parts += [bar(170 + 150 * k, 14, 14, 14, color), text(190 + 150 * k, 26, label, "start")]
    for group, name in enumerate(names):
        left = 30 + 112 * group
        parts.append(text(left + 50, 258, name))
        for k, (_, column, color) in enumerate(kinds):
            share = number(rows[name][column])
            parts.append(bar(left + 33 * k, 240 - 1.75 * share, 30, 1.75 * share, color))
            parts.append(text(left + 33 * k + 15, 235 - 1.75 * share, f"{share:.0f}", size=12))
    parts.append(text(WIDTH / 2, 284, "% of 40 answers a category, hand-held views", size=12))
    save("summary_accuracy", 296, "Percentages of answers within 5, 10 and 30 degrees, by category", parts)


def lying(name: str, alt: str, rows: dict[str, tuple[float, str, str]], note: str, log: bool) -> None:
    """Bars one below the other: value, what is written at the end, and colour."""
    most, parts = max(value for value, _, _ in rows.values()), []
    for k, (label, (value, words, color)) in enumerate(rows.items()):
        # On a logarithmic axis the bars begin at a half.
        share = math.log(value / 0.5) / math.log(most / 0.5) if log else value / most
        parts += [text(190, 32 + 34 * k, label, "end"), bar(200, 16 + 34 * k, 420 * share, 24, color)]
        parts.append(text(208 + 420 * share, 33 + 34 * k, words, "start"))
    height = 16 + 34 * len(rows) + 26
    parts.append(text(200, height - 12, note, "start", 12))
    save(name, height, alt, parts)


if __name__ == "__main__":
    accuracy()
    seconds = {name: number(cells[0]) for name, cells in table("speed/README.md", "| way | s a view |").items()}
    ways = {name: (s, f"{s:.3g} s", PALE if name == "released" else BLUE) for name, s in seconds.items()}
    note = "seconds a view on two CPU cores, logarithmic"
    lying("summary_speed", "Seconds for one view by the released schedule and by kfit", ways, note, True)
    off = {name: number(cells[-1]) for name, cells in table("details.md", "| | median rotation | AP5 |").items()}
    kinds = {name: (cm, f"{cm:g} cm", ORANGE if name.endswith("RGB-D") else PALE) for name, cm in off.items()}
    note = "median error of the translation"
    lying("summary_depth", "Error of the translation with colour alone and with depth", kinds, note, False)
