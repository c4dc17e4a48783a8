"""Draws kfit's folders and the life of a fit: python docs/drawings/how_built.py [FOLDER]."""

from __future__ import annotations

import sys
from pathlib import Path

INK, PALE, PAPER = "#2b2f36", "#6b7280", "#fcfcfd"
GREEN, BLUE, ORANGE = "#1f9254", "#2f6fde", "#d9730d"
# Folders by height, the uppermost first, each with what its floor is for; those of `tests/test_import_direction.py`.
FLOORS = [
    ("commands and page", BLUE, ["cli", "app"]),
    ("measure", BLUE, ["bench"]),
    ("many photos", BLUE, ["batch"]),
    ("use answers", BLUE, ["models", "tracking", "reports"]),
    ("photo to answer, training", ORANGE, ["pose", "training"]),
    ("rivals of the paper, registration", ORANGE, ["baselines", "registration"]),
    ("the pipeline", GREEN, ["fitting"]),
    ("parts, one a file", GREEN, ["generators", "energies", "initializers", "optimizers"]),
    ("", GREEN, ["selectors", "callbacks", "features"]),
    ("", GREEN, ["metrics", "data", "segmentation"]),
    ("pure functions", INK, ["geometry"]),
    ("contracts; machine", INK, ["core", "runtime"]),
]
WIDTH, HEIGHT = 1000, 640


def text(
    x: float, y: float, words: str, size: int = 15, color: str = INK, anchor: str = "middle", bold: bool = False
) -> str:
    """Words at a place."""
    weight = ' font-weight="600"' if bold else ""
    return f'<text x="{x:g}" y="{y:g}" font-size="{size}" fill="{color}" text-anchor="{anchor}"{weight}>{words}</text>'


def box(x: float, y: float, width: float, height: float, color: str, words: str, below: str = "") -> str:
    """A box with its name, and under it what it does."""
    middle = y + height / 2
    lines = [text(x + width / 2, middle + (5 if not below else -3), words, 14, color, bold=True)]
    lines += [text(x + width / 2, middle + 15, below, 12)] if below else []
    frame = (
        f'<rect x="{x:g}" y="{y:g}" width="{width:g}" height="{height:g}" rx="6" fill="white" stroke="{color}" '
        'stroke-width="1.6"/>'
    )
    return "\n".join([frame, *lines])


def arrow(*points: tuple[float, float], color: str = INK) -> str:
    """A line through these points, with its tip at the last."""
    path = " ".join(f"{x:g},{y:g}" for x, y in points)
    return f'<polyline points="{path}" fill="none" stroke="{color}" stroke-width="1.8" marker-end="url(#tip)"/>'


def rooms() -> list[str]:
    """The folders of kfit, floor above floor."""
    drawn = [text(230, 34, "The folders: imports go down", 18, bold=True)]
    top, step, left, width = 56, 47, 40, 410
    for row, (label, color, names) in enumerate(FLOORS):
        y = top + row * step
        each = (width - 8 * (len(names) - 1)) / len(names)
        if label:
            drawn.append(text(left, y + 9, label, 11, PALE, "start"))
        drawn += [box(left + k * (each + 8), y + 13, each, 28, color, name) for k, name in enumerate(names)]
    drawn.append(arrow((20, top + 16), (20, top + len(FLOORS) * step - 8)))
    return drawn


def life() -> list[str]:
    """A fit, from a photo to an answer."""
    left, right, wide = 510, 770, 200
    middle = left + wide / 2
    return [
        text(740, 34, "The life of a fit", 18, bold=True),
        box(left, 56, wide, 48, ORANGE, "photo", "read, find, crop"),
        arrow((middle, 104), (middle, 132)),
        box(left, 134, wide, 48, GREEN, "Observation", "image, mask, depth, camera"),
        arrow((middle, 182), (middle, 210)),
        box(left, 212, wide, 48, GREEN, "Initializer", "B problems × S starts = rows"),
        arrow((middle, 260), (middle, 316)),
        # what repeats
        f'<rect x="494" y="290" width="492" height="196" rx="10" fill="none" stroke="{PALE}" stroke-dasharray="5 4"/>',
        text(976, 308, "every step, all rows at once", 12, PALE, "end"),
        box(left, 318, wide, 48, GREEN, "Generator", "draws pictures from variables"),
        arrow((left + wide, 342), (right - 2, 342)),
        box(right, 318, wide, 48, GREEN, "Energy, Prior", "compare; a weighted sum"),
        arrow((right + wide / 2, 366), (right + wide / 2, 416)),
        box(right, 418, wide, 48, GREEN, "Optimizer", "moves each row downhill"),
        arrow((right, 442), (left + wide + 2, 442)),
        box(left, 418, wide, 48, GREEN, "Callback", "prune, stop, show"),
        arrow((middle, 418), (middle, 368)),
        arrow((right + wide / 2, 466), (right + wide / 2, 508)),
        box(right, 510, wide, 48, GREEN, "Selector", "the winning row a problem"),
        arrow((right, 534), (left + wide + 2, 534)),
        box(left, 510, wide, 48, GREEN, "FitResult", "winner, all starts, history"),
        arrow((middle, 558), (middle, 580)),
        box(left, 582, wide, 48, ORANGE, "PoseResult", "pose, size, confidence"),
        text(right + wide / 2, 88, "kfit.pose", 13, ORANGE),
        text(right + wide / 2, 108, "knows photos and poses", 13),
        text(right + wide / 2, 168, "kfit.FitPipeline", 13, GREEN),
        text(right + wide / 2, 188, "knows pictures and variables", 13),
    ]


def drawing() -> str:
    """The whole sheet."""
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" font-family="system-ui, sans-serif">\n'
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="{PAPER}"/>\n'
        '<defs><marker id="tip" viewBox="0 0 10 10" refX="9" refY="5" markerWidth="7" markerHeight="7" orient="auto">'
        f'<path d="M0,0 L10,5 L0,10 z" fill="{INK}"/></marker></defs>'
    )
    return "\n".join([head, *rooms(), *life(), "</svg>\n"])


def main() -> None:
    """Write the drawing into the folder, that of the pages unless named."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parents[1] / "pictures"
    (folder / "how_built.svg").write_text(drawing())


if __name__ == "__main__":
    main()
