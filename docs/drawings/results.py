"""Draws docs/results/README.md's plots, from the tables there, and the social card: python docs/drawings/results.py."""

from __future__ import annotations

import re
from pathlib import Path

import matplotlib

matplotlib.use("agg")
import matplotlib.pyplot as plt
import numpy as np
from PIL import Image

DOCS = Path(__file__).parents[1]
INK, ORANGE, BLUE, PALE = "#2b2f36", "#d9730d", "#2f6fde", "#b9c0cc"
plt.rcParams |= {
    "font.size": 11,
    "text.color": INK,
    "axes.edgecolor": PALE,
    "svg.fonttype": "path",
    "svg.hashsalt": "k",
}


def table(page: str, head: str) -> dict[str, list[str]]:
    """Rows of the first table on a page whose head begins so, by their first cell."""
    rows: dict[str, list[str]] = {}
    for line in (DOCS / "results" / page).read_text(encoding="utf-8").partition(head)[2].splitlines()[2:]:
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


def accuracy() -> None:
    """Shares of answers within 5°, 10° and 30°."""
    rows = table("accuracy/README.md", "| of | number | median | < 5° | < 10° | < 30°")
    names = ["bottle", "bowl", "camera", "can", "laptop", "mug"]
    figure, axes = plt.subplots(figsize=(7.2, 2.9), layout="constrained")
    for k, (label, column, color) in enumerate((("30°", 4, PALE), ("10°", 3, ORANGE), ("5°", 2, BLUE))):
        shares = [number(rows[name][column]) for name in names]
        places = np.arange(len(names)) + 0.27 * (1 - k)
        axes.bar(places, shares, 0.25, color=color, label=f"within {label}")
        for place, share in zip(places, shares, strict=True):
            axes.text(place, share + 1, f"{share:.0f}", ha="center", fontsize=8.5)
    axes.set(xticks=range(len(names)), xticklabels=names, ylabel="% of 200 answers", ylim=(0, 112))
    axes.legend(frameon=False, ncols=3, loc="upper center", bbox_to_anchor=(0.5, 1.17))
    finish(figure, axes, "summary_accuracy")


def speed() -> None:
    """Seconds for one view."""
    rows = table("speed/README.md", "| way | s a view |")
    seconds = {name: number(cells[0]) for name, cells in rows.items()}
    figure, axes = plt.subplots(figsize=(7.2, 2.0), layout="constrained")
    names = list(seconds)[::-1]
    axes.barh(names, [seconds[name] for name in names], color=[BLUE if n != "released" else PALE for n in names])
    for name in names:
        axes.text(seconds[name] * 1.08, name, f"{seconds[name]:.3g} s", va="center")
    axes.set(xscale="log", xlim=(0.5, 320), xlabel="seconds a view, two CPU cores (each mark is ten times the last)")
    finish(figure, axes, "summary_speed")


def depth() -> None:
    """Median error of the distance with colour alone and with depth."""
    rows = table("details.md", "| | median rotation | AP5 |")
    figure, axes = plt.subplots(figsize=(7.2, 1.9), layout="constrained")
    names = list(rows)[::-1]
    values = [number(rows[name][-1]) for name in names]
    axes.barh(names, values, color=[ORANGE if name.endswith("RGB-D") else PALE for name in names])
    for name, value in zip(names, values, strict=True):
        axes.text(value + 0.2, name, f"{value:g} cm", va="center")
    axes.set(xlabel="median error of the translation [cm]", xlim=(0, 19))
    finish(figure, axes, "summary_depth")


def finish(figure: plt.Figure, axes: plt.Axes, name: str) -> None:
    """Write an SVG file without what changes from run to run."""
    axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(DOCS / "results" / f"{name}.svg", metadata={"Date": None})
    plt.close(figure)


def social_card() -> None:
    """The card that links to kfit show, 1280 x 640."""
    figure = plt.figure(figsize=(12.8, 6.4), dpi=100, facecolor="#1c1e22")
    axes = figure.add_axes((0.47, 0.1, 0.5, 0.8))
    axes.imshow(np.asarray(Image.open(DOCS / "pictures/answer.jpg")))
    axes.axis("off")
    figure.text(0.05, 0.62, "kfit", color="#ffb000", fontsize=76, weight="bold")
    figure.text(0.05, 0.50, "Fit a picture.", color="white", fontsize=34)
    words = "Where it is, how it is turned, how large:\nfrom one photo, without a CAD model,\nby drawing it."
    figure.text(0.05, 0.24, words, color="#d5d9e0", fontsize=19, linespacing=1.5)
    held = DOCS / "_static/social.png"
    figure.savefig(held, facecolor=figure.get_facecolor())
    plt.close(figure)
    Image.open(held).convert("RGB").quantize(128).save(held, optimize=True)


if __name__ == "__main__":
    accuracy()
    speed()
    depth()
    social_card()
