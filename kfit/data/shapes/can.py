"""Cans: tins, drink cans and jars with prints, rims, beads, lids and undersides; round but for print and tab."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kfit.data.mesh import Mesh, join
from kfit.data.shapes import can_ends, colors, prints, textures
from kfit.data.shapes.primitives import revolve

Span = tuple[float, float]


@dataclass(frozen=True)
class Form:
    """Height over width, radii of the ends over the wall's, shoulders over the height, beads, tops and bottom.

    ``end`` and ``shoulder`` are of the upper end, ``foot`` and ``heel`` of the lower one; ``bulge`` is how much wider
    the middle is than the ends. ``band`` is the part of the height that is printed, and ``tops`` and ``bottom`` are
    kinds of ``can_ends``.
    """

    height: Span
    end: Span
    shoulder: Span
    beads: tuple[int, int] = (0, 1)
    tops: tuple[str, ...] = ("ring", "ring", "seam", "opened")
    bottom: str = "seam"
    foot: Span = (0.97, 1.0)
    heel: Span = (0.01, 0.02)
    bulge: float = 0.0
    band: Span = (0.0, 1.0)


SHAPES = {
    "food": Form((1.2, 1.6), (0.97, 1.0), (0.01, 0.02)),
    "ribbed": Form((1.2, 1.6), (0.97, 1.0), (0.01, 0.02), (5, 14)),
    "drink": Form(
        (1.7, 2.1),
        (0.78, 0.88),
        (0.06, 0.1),
        tops=("tab",),
        bottom="dome",
        foot=(0.7, 0.8),
        heel=(0.05, 0.09),
    ),
    "slim": Form(
        (2.2, 2.8),
        (0.82, 0.92),
        (0.04, 0.07),
        tops=("tab",),
        bottom="dome",
        foot=(0.7, 0.84),
        heel=(0.04, 0.07),
    ),
    "half_litre": Form(
        (2.35, 2.65),
        (0.76, 0.84),
        (0.06, 0.09),
        tops=("tab",),
        bottom="dome",
        foot=(0.7, 0.78),
        heel=(0.04, 0.06),
    ),
    "stubby": Form(
        (1.25, 1.6),
        (0.78, 0.88),
        (0.07, 0.12),
        tops=("tab",),
        bottom="dome",
        foot=(0.7, 0.8),
        heel=(0.06, 0.1),
    ),
    "tuna": Form((0.35, 0.55), (0.94, 1.0), (0.02, 0.05), foot=(0.92, 1.0), heel=(0.02, 0.1)),
    "wide": Form((0.85, 1.15), (0.96, 1.0), (0.01, 0.03), (0, 3)),
    "catering": Form((1.05, 1.3), (0.98, 1.0), (0.01, 0.02), (3, 8), tops=("seam", "opened", "plastic")),
    "powder": Form((1.1, 1.7), (0.97, 1.0), (0.01, 0.02), (0, 2), tops=("plastic", "plastic", "ring")),
    "tea": Form((0.9, 1.6), (1.0, 1.0), (0.005, 0.01), tops=("slip",), foot=(0.99, 1.0)),
    "candle": Form((0.45, 0.8), (1.0, 1.0), (0.005, 0.01), tops=("slip", "opened"), foot=(0.97, 1.0)),
    "jar": Form(
        (1.1, 1.6),
        (0.8, 0.93),
        (0.06, 0.12),
        tops=("screw",),
        bottom="glass",
        foot=(0.86, 0.96),
        heel=(0.04, 0.08),
        band=(0.15, 0.75),
    ),
    "jam": Form(
        (0.85, 1.2),
        (0.84, 0.96),
        (0.05, 0.12),
        tops=("screw",),
        bottom="glass",
        foot=(0.84, 0.95),
        heel=(0.05, 0.1),
        bulge=0.04,
        band=(0.2, 0.7),
    ),
    "stackable": Form((0.7, 1.1), (0.97, 1.0), (0.01, 0.02), (0, 2), foot=(0.86, 0.93), heel=(0.06, 0.14)),
}
HELD_OUT_SHAPES = {
    "aerosol": Form((2.0, 3.0), (0.9, 1.0), (0.02, 0.03), tops=("spray",)),
    "paint": Form((0.95, 1.25), (1.0, 1.0), (0.01, 0.02), (1, 3), tops=("slip", "seam")),
    "flat": Form((0.55, 0.8), (0.93, 1.0), (0.02, 0.05), (2, 5)),
    "keg": Form(
        (1.3, 1.7),
        (0.84, 0.9),
        (0.08, 0.14),
        tops=("seam", "tab"),
        foot=(0.84, 0.9),
        heel=(0.08, 0.14),
        bulge=0.05,
    ),
    "spice": Form(
        (1.6, 2.2),
        (0.8, 0.92),
        (0.03, 0.06),
        tops=("screw",),
        bottom="glass",
        foot=(0.9, 0.98),
        heel=(0.02, 0.05),
        band=(0.1, 0.6),
    ),
    "preserve": Form(
        (1.2, 1.7),
        (0.62, 0.75),
        (0.2, 0.3),
        tops=("screw",),
        bottom="glass",
        foot=(0.8, 0.9),
        heel=(0.05, 0.1),
        band=(0.15, 0.55),
    ),
}
TEXTURES: dict[str, tuple[textures.Family, float]] = {
    "label": (prints.label, 5.0),
    "plain": (textures.plain, 0.7),
    "emblem": (prints.emblem, 1.5),
    "lettering": (prints.lettering, 1.5),
    "two_tone": (textures.two_tone, 0.8),
    "rings": (textures.rings, 0.8),
    "gradient": (textures.gradient, 0.7),
    "picture": (prints.picture_print, 1.0),
}
HELD_OUT_TEXTURES: dict[str, tuple[textures.Family, float]] = {
    "stripes": (textures.stripes, 1.0),
    "checks": (textures.checks, 0.7),
    "blotches": (textures.blotches, 0.7),
    "marble": (textures.marble, 0.7),
}
# Share of taught cans whose shape belongs to no family, and of those whose pattern belongs to none.
FREE = 0.35
FREE_TOPS = tuple(sorted({top for form in SHAPES.values() for top in form.tops}))


def build(rng: np.random.Generator, held_out: bool) -> Mesh:
    """A can in body widths, to be normalised by the caller."""
    shapes = HELD_OUT_SHAPES if held_out else SHAPES
    form = shapes[str(rng.choice(list(shapes)))]
    family = textures.choose(rng, HELD_OUT_TEXTURES if held_out else TEXTURES)
    if not held_out and rng.random() < FREE:
        form = _free(rng)
    if not held_out and rng.random() < FREE:
        family = textures.mixed
    height = float(rng.uniform(*form.height))
    tin = colors.metal(rng)
    base = tin if rng.random() < 0.15 else colors.any_color(rng, whites=0.25)
    wall, printed = _wall(rng, form, height, int(rng.integers(*form.beads)))
    # Drink cans are printed up to the neck; tins have bare ends, and jars show what is in them.
    glass = form.bottom == "glass"
    bare = colors.hue(rng, None, (0.1, 0.8), (0.3, 0.9)) if glass else tin if rng.random() < 0.7 else base
    skin = family(rng, base, (224, 448))
    low, high = printed
    parts = [revolve(wall[low:high], skin, can_ends.AROUND)]
    tile = textures.solid(bare)
    parts += [revolve(piece, tile, can_ends.AROUND) for piece in (wall[: low + 1], wall[high - 1 :]) if len(piece) > 1]
    parts += can_ends.bottom(rng, form.bottom, float(wall[0, 0]), bare if glass else tin)
    parts += can_ends.top(rng, str(rng.choice(form.tops)), float(wall[-1, 0]), height, tin)
    return join(parts)


def _free(rng: np.random.Generator) -> Form:
    """A can of no family: flat to tall, with any shoulders, beads, ends and print."""
    height, beads = float(np.exp(rng.uniform(np.log(0.35), np.log(3.0)))), int(rng.integers(0, 14))
    end, foot = rng.uniform(0.65, 1.0, 2)
    shoulder, heel = np.exp(rng.uniform(np.log([0.008, 0.01]), np.log([0.25, 0.14])))
    start, stop = rng.uniform(0, 0.25), rng.uniform(0.6, 1.0)
    return Form(
        (height, height),
        (end, end),
        (shoulder, shoulder),
        (0, 1) if rng.random() < 0.6 else (beads, beads + 1),
        tops=FREE_TOPS,
        bottom=str(rng.choice(["seam", "dome", "glass"])),
        foot=(foot, foot),
        heel=(heel, heel),
        bulge=float(rng.uniform(-0.03, 0.06)) if rng.random() < 0.4 else 0.0,
        band=(start, stop) if rng.random() < 0.4 else (0.0, 1.0),
    )


def _wall(rng: np.random.Generator, form: Form, height: float, beads: int) -> tuple[np.ndarray, tuple[int, int]]:
    """Profile of the side and which of its rows are printed: shoulders at both ends, beads around the middle."""
    end, foot = 0.5 * rng.uniform(*form.end), 0.5 * rng.uniform(*form.foot)
    shoulder, heel = height * rng.uniform(*form.shoulder), height * rng.uniform(*form.heel)
    levels = np.linspace(0, height, 66 if beads > 1 else 30)
    levels = np.unique(np.concatenate([levels, np.linspace(0, heel, 5), np.linspace(height - shoulder, height, 5)]))
    low = np.clip(1 - levels / heel, 0, 1) ** 1.3
    high = np.clip(1 - (height - levels) / shoulder, 0, 1) ** 1.3
    radius = 0.5 - (0.5 - foot) * low - (0.5 - end) * high
    radius += 0.5 * form.bulge * (np.sin(np.pi * levels / height) - 1)
    if beads:
        middle = (levels / height - 0.5) / rng.uniform(0.25, 0.38)
        wave = 0.5 - 0.5 * np.cos(2 * np.pi * beads * (middle + 1) / 2)
        radius -= 0.012 * wave * (np.abs(middle) < 1)
    start, stop = max(form.band[0] * height, heel), min(form.band[1] * height, height - shoulder)
    rows = int(np.searchsorted(levels, start - 1e-9)), int(np.searchsorted(levels, stop + 1e-9))
    return np.stack([radius, levels], axis=1), rows
