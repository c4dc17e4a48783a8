"""Bottles: lofted bodies of round, oval or square section with necks, caps, pumps and labels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kfit.data.mesh import Mesh, join
from kfit.data.shapes import bottle_tops, colors, prints, textures
from kfit.data.shapes.primitives import circle, plate, revolve, rounded_rectangle, sheet, smooth


@dataclass(frozen=True)
class Form:
    """A family: radius at rising heights (both 0 to 1), body height over width, depth over width, section and tops.

    ``profile`` runs from the foot to where the top begins; ``section`` is "round", "oval" or "square".
    """

    profile: tuple[tuple[float, float], ...]
    height: tuple[float, float]
    section: str
    tops: tuple[str, ...]
    depth: tuple[float, float] = (1.0, 1.0)
    label: tuple[float, float] = (0.15, 0.65)


SHAPES = {
    "wine": Form(
        ((1, 0), (1, 0.3), (1, 0.58), (0.85, 0.66), (0.36, 0.76), (0.33, 1)), (3.2, 4.2), "round", ("cork", "screw")
    ),
    "beer": Form(((1, 0), (1, 0.3), (1, 0.52), (0.82, 0.62), (0.42, 0.78), (0.38, 1)), (3.0, 3.9), "round", ("crown",)),
    "water": Form(
        ((0.96, 0), (1, 0.2), (0.93, 0.4), (1, 0.55), (0.98, 0.68), (0.6, 0.88), (0.36, 1)),
        (2.6, 3.6),
        "round",
        ("screw",),
    ),
    "shampoo": Form(
        ((0.95, 0), (1, 0.2), (0.99, 0.6), (0.92, 0.82), (0.6, 0.97), (0.4, 1)),
        (1.8, 2.8),
        "oval",
        ("flip", "screw", "pump"),
        (0.45, 0.75),
    ),
    "pump": Form(((0.98, 0), (1, 0.3), (1, 0.8), (0.75, 0.95), (0.4, 1)), (1.5, 2.4), "round", ("pump",)),
    "square": Form(
        ((1, 0), (1, 0.4), (1, 0.78), (0.75, 0.9), (0.4, 1)), (1.6, 2.6), "square", ("screw", "pump"), (0.6, 1.0)
    ),
    "sports": Form(
        ((0.93, 0), (1, 0.15), (0.88, 0.55), (0.98, 0.75), (0.85, 1)), (2.0, 2.8), "round", ("spout", "screw")
    ),
    "tube": Form(((0.97, 0), (1, 0.1), (1, 0.6), (1, 0.95), (0.9, 1)), (2.4, 3.4), "round", ("wide",)),
}
HELD_OUT_SHAPES = {
    "sauce": Form(
        ((0.85, 0), (1, 0.15), (0.95, 0.5), (0.8, 0.7), (0.5, 0.9), (0.4, 1)),
        (2.2, 3.0),
        "oval",
        ("nozzle",),
        (0.5, 0.75),
    ),
    "flask": Form(
        ((1, 0), (1, 0.35), (0.98, 0.7), (0.55, 0.85), (0.5, 1)), (2.2, 3.2), "square", ("wide",), (0.5, 0.8)
    ),
    "bulb": Form(
        ((0.75, 0), (1, 0.2), (0.95, 0.42), (0.5, 0.62), (0.34, 0.8), (0.34, 1)),
        (2.2, 3.0),
        "round",
        ("cork", "nozzle"),
    ),
}
TEXTURES: dict[str, tuple[textures.Family, float]] = {
    "plain": (textures.plain, 3.0),
    "gradient": (textures.gradient, 1.0),
    "two_tone": (textures.two_tone, 1.0),
    "emblem": (prints.emblem, 1.5),
    "lettering": (prints.lettering, 1.5),
    "rings": (textures.rings, 0.7),
    "speckle": (textures.speckle, 0.5),
}
HELD_OUT_TEXTURES: dict[str, tuple[textures.Family, float]] = {
    "stripes": (textures.stripes, 1.0),
    "marble": (textures.marble, 0.7),
    "zigzag": (textures.zigzag, 0.5),
    "picture": (prints.picture_print, 1.0),
}


def build(rng: np.random.Generator, held_out: bool) -> Mesh:
    """A bottle in body widths, to be normalised by the caller. An oval or square one is wide along z, NOCS's side."""
    shapes = HELD_OUT_SHAPES if held_out else SHAPES
    form = shapes[str(rng.choice(list(shapes)))]
    family = textures.choose(rng, HELD_OUT_TEXTURES if held_out else TEXTURES)
    height = float(rng.uniform(*form.height))
    base = _body_color(rng)
    section = _section(rng, form)
    controls = np.array(form.profile) * [0.5, height] * (1 + rng.normal(0, 0.02, (len(form.profile), 1)) * [1, 0])
    profile = smooth(controls, 56)
    corner = rng.uniform(0.02, 0.08)
    lifted = np.clip(1 - profile[:, 1] / corner, 0, 1)
    profile[:, 0] -= corner * 0.7 * (1 - np.sqrt(1 - lifted**2))
    neck = float(profile[-1, 0])
    # The neck is round whatever the body's section: the section blends into a circle where the body narrows.
    skin = family(rng, base, (256, 384))
    parts = [_loft(profile, section, neck, skin), plate(section * profile[0, 0], 0.0, textures.solid(base * 0.8), -1)]
    if (rng.random() < 0.7 and not held_out) or (held_out and rng.random() < 0.4):
        parts.append(_label(rng, form, profile, section, height, base))
    parts += bottle_tops.build(rng, str(rng.choice(form.tops)), neck, height, base)
    return join(parts)


def _body_color(rng: np.random.Generator) -> np.ndarray:
    """Dark or green glass, clear plastic, white plastic, or any colour."""
    kind = rng.random()
    if kind < 0.2:
        return colors.hue(rng, float(rng.uniform(0.06, 0.4)), (0.4, 0.9), (0.08, 0.4))
    if kind < 0.35:
        return colors.hue(rng, float(rng.uniform(0.4, 0.62)), (0.03, 0.2), (0.65, 0.92))
    if kind < 0.6:
        return colors.white(rng)
    return colors.any_color(rng, whites=0.1)


def _section(rng: np.random.Generator, form: Form) -> np.ndarray:
    """Closed outline whose half width along z is 1."""
    depth = float(rng.uniform(*form.depth))
    if form.section == "square":
        return rounded_rectangle(2 * depth, 2.0, rng.uniform(0.15, 0.6) * depth, 12)
    return circle(48) * [depth, 1.0]


def _loft(profile: np.ndarray, section: np.ndarray, neck: float, texture: np.ndarray) -> Mesh:
    """The body, whose section becomes a circle as it narrows to the neck; without narrowing it stays."""
    mesh = revolve(profile, texture, section=section)
    points = mesh.vertices.reshape(len(profile), len(section), 3)
    angle = np.arctan2(section[:, 0], section[:, 1])
    round_section = np.stack([np.sin(angle), np.cos(angle)], axis=1)
    width = float(profile[:, 0].max())
    top = np.arange(len(profile)) > int(np.argmax(profile[:, 0] > 0.97 * width))
    share = np.clip((0.9 * width - profile[:, 0]) / max(0.9 * width - neck, 1e-3), 0, 1) * top
    blended = section[None] + (round_section - section)[None] * share[:, None, None]
    grid = np.stack(
        [profile[:, :1] * blended[..., 0], points[..., 1].astype(np.float64), profile[:, :1] * blended[..., 1]], axis=-1
    )
    return sheet(grid, texture)


def _label(
    rng: np.random.Generator,
    form: Form,
    profile: np.ndarray,
    section: np.ndarray,
    height: float,
    base: np.ndarray,
) -> Mesh:
    """A label around the straight part of the body, a hair outside it."""
    low, high = form.label
    start = height * rng.uniform(low * 0.5, low * 1.4)
    stop = height * rng.uniform(high * 0.75, high)
    # Where the body narrows its section turns round, and a label would sink into it.
    wide = profile[profile[:, 0] > 0.93 * profile[:, 0].max(), 1]
    stop = max(min(stop, float(wide.max())), start + 0.1 * height)
    rows = np.linspace(start, stop, 14)
    band = np.stack([np.interp(rows, profile[:, 1], profile[:, 0]) + 0.01, rows], axis=1)
    texture = prints.label(rng, base, (160, 448))
    return revolve(band, texture, section=section)
