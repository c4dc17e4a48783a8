"""Pictures side by side under their names: what a script shows at its end."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from torch import Tensor

# Width of a picture, space between two and height of a line of text in inches, and pixels an inch.
CELL, GAP, LINE, DPI = 2.0, 0.06, 0.18, 144
GREY = "#cccccc"


def picture_table(columns: Mapping[str, Tensor], rows: Sequence[str] = ()) -> Figure:
    """Draw a table of pictures: a column a name, a row a picture of each.

    Args:
        columns: by what is written above them, (R, 3, H, W) RGB or (R, 1, H, W) grey in [0, 1], all of one size.
        rows: labels of the rows, or empty.

    Returns:
        The figure; its ``savefig`` writes it.

    Raises:
        ValueError: if there are no columns, or the columns and ``rows`` do not have as many rows.
    """
    if not columns:
        raise ValueError("columns must hold at least one column of pictures, got none")
    counts = {name: len(pictures) for name, pictures in columns.items()} | ({"rows": len(rows)} if rows else {})
    if len(set(counts.values())) > 1:
        raise ValueError(f"columns and rows must have as many rows as one another, got {counts}")
    height, width = next(iter(columns.values())).shape[-2:]
    count, high = next(iter(counts.values())), CELL * height / width
    lines = max(name.count("\n") + 1 for name in columns)
    text = LINE * lines + GAP
    size = (1.2 * LINE * bool(rows) + (CELL + GAP) * len(columns), text + (high + GAP) * count)
    layout = ConstrainedLayoutEngine(w_pad=GAP / 2, h_pad=GAP / 2, wspace=0, hspace=0)
    figure = Figure(figsize=size, dpi=DPI, layout=layout)
    grid = figure.subplots(count, len(columns), squeeze=False)
    for number, (name, pictures) in enumerate(columns.items()):
        grid[0, number].set_title(name, fontsize=9, pad=4)
        for axes, picture in zip(grid[:, number], pictures.detach().cpu().float().clamp(0, 1), strict=True):
            # Small pictures are interpolated smoothly; matplotlib resamples large ones.
            smooth = "bicubic" if picture.shape[-1] < CELL * DPI else "auto"
            axes.imshow(picture.movedim(0, -1).numpy(), cmap="gray", vmin=0, vmax=1, interpolation=smooth)
            axes.set(xticks=[], yticks=[])
            axes.spines[:].set_color(GREY)
    for axes, row in zip(grid[:, 0], rows, strict=False):
        axes.set_ylabel(row, fontsize=9)
    return figure
