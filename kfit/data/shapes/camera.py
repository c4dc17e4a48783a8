"""Cameras: a body with lens, hump, grip and dials; the lens points along +x, NOCS's side for it, the width along z.

The CAMERA split's mean box of this category is widest along z (x 0.46, y 0.49, z 0.70), and the vertices of REAL275's
``camera_canon_len_norm.obj`` form a round disc, the lens's front, at its greatest x.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kfit.data.mesh import Mesh, join
from kfit.data.shapes import camera_parts, colors, prints, textures
from kfit.data.shapes.placing import FRONT_TO_X, shift
from kfit.data.shapes.primitives import rounded_rectangle, slab


@dataclass(frozen=True)
class Form:
    """Ranges in body widths: height, depth, corner radius, the lens's radius over the height and length, its place.

    ``hump`` and ``grip`` are the chances of a prism or flash on top and of a grip.
    """

    height: tuple[float, float]
    depth: tuple[float, float]
    corner: tuple[float, float]
    lens_radius: tuple[float, float]
    lens_length: tuple[float, float]
    lens_place: tuple[float, float]
    hump: float
    grip: float


SHAPES = {
    "compact": Form((0.55, 0.68), (0.18, 0.28), (0.03, 0.12), (0.28, 0.4), (0.04, 0.25), (-0.02, 0.14), 0.1, 0.3),
    "reflex": Form((0.6, 0.75), (0.3, 0.45), (0.08, 0.16), (0.36, 0.47), (0.3, 0.95), (-0.02, 0.08), 1.0, 1.0),
    "rangefinder": Form((0.5, 0.62), (0.2, 0.3), (0.05, 0.14), (0.3, 0.42), (0.12, 0.4), (-0.04, 0.08), 0.05, 0.1),
    "bridge": Form((0.62, 0.8), (0.35, 0.6), (0.08, 0.18), (0.36, 0.46), (0.25, 0.7), (0.0, 0.1), 0.8, 1.0),
    "mirrorless": Form((0.55, 0.65), (0.22, 0.34), (0.05, 0.12), (0.36, 0.46), (0.2, 0.7), (0.0, 0.1), 0.45, 0.8),
}
HELD_OUT_SHAPES = {
    "instant": Form((0.75, 1.0), (0.45, 0.65), (0.05, 0.15), (0.22, 0.34), (0.06, 0.2), (-0.05, 0.05), 0.5, 0.0),
    "studio": Form((0.95, 1.15), (0.45, 0.6), (0.08, 0.15), (0.26, 0.32), (0.3, 0.9), (-0.02, 0.05), 1.0, 1.0),
}
TEXTURES: dict[str, tuple[textures.Family, float]] = {
    "plain": (camera_parts.plain_skin, 2.5),
    "leather": (camera_parts.leather_skin, 2.5),
    "banded": (camera_parts.banded_skin, 1.5),
}
HELD_OUT_TEXTURES: dict[str, tuple[textures.Family, float]] = {
    "wood": (textures.wood, 1.0),
    "striped": (textures.rings, 1.0),
    "blotches": (textures.blotches, 0.7),
}


def build(rng: np.random.Generator, held_out: bool) -> Mesh:
    """A camera in body widths, to be normalised by the caller."""
    shapes = HELD_OUT_SHAPES if held_out else SHAPES
    name = str(rng.choice(list(shapes)))
    form = shapes[name]
    family = textures.choose(rng, HELD_OUT_TEXTURES if held_out else TEXTURES)
    height, depth, corner = (float(rng.uniform(*span)) for span in (form.height, form.depth, form.corner))
    base = _body_color(rng, name)
    top = base if rng.random() < 0.7 else colors.metal(rng)
    outline = rounded_rectangle(1.0, depth, corner)
    cover = textures.solid(top)
    parts = slab(
        outline,
        0.0,
        height,
        rng.uniform(0.02, 0.06),
        (cover, family(rng, base, (160, 448)), textures.solid(base * 0.8)),
    )
    radius = height * rng.uniform(*form.lens_radius)
    length = float(rng.uniform(*form.lens_length))
    place = (float(rng.uniform(*form.lens_place)), float(height * rng.uniform(0.44, 0.52)), depth / 2)
    trim = base if rng.random() < 0.6 else colors.metal(rng)
    parts += [part.transformed(shift(*place)) for part in camera_parts.lens(rng, radius, length, trim)]
    if rng.random() < form.hump:
        parts += _hump(rng, place[0], height, depth, base)
    if rng.random() < form.grip:
        parts += _grip(rng, height, depth, base if rng.random() < 0.5 else colors.black(rng))
    parts += camera_parts.controls(rng, height, depth, colors.metal(rng) if rng.random() < 0.5 else base * 0.8)
    parts += camera_parts.front(rng, height, depth, place[0] + radius, base)
    parts += camera_parts.rear(rng, height, depth, base)
    return join(parts).transformed(FRONT_TO_X)


def _body_color(rng: np.random.Generator, name: str) -> np.ndarray:
    """Mostly black or silver; compact and instant cameras come in any colour."""
    if rng.random() < (0.5 if name in ("compact", "instant") else 0.08):
        return colors.any_color(rng, 0.25)
    return colors.black(rng) if rng.random() < 0.6 else colors.metal(rng)


def _hump(rng: np.random.Generator, middle: float, height: float, depth: float, color: np.ndarray) -> list[Mesh]:
    """The prism's housing above the lens, narrower towards its top, with a name on its front and sometimes a shoe."""
    wide, deep, tall = rng.uniform(0.26, 0.42), depth * rng.uniform(0.65, 1.0), rng.uniform(0.08, 0.2)
    tile = textures.solid(color)
    outline = rounded_rectangle(wide, deep, 0.05)
    housing = join(slab(outline, 0.0, tall, 0.03, (tile, tile, tile)))
    share = housing.vertices[:, 1:2] / tall
    narrowed = housing.vertices * (1 - share * np.array([rng.uniform(0.2, 0.5), 0, rng.uniform(0.0, 0.3)]))
    housing = Mesh(narrowed.astype(np.float32), housing.faces, housing.normals, housing.uv, housing.texture)
    at = shift(middle, height - 0.01, 0)
    parts = [housing.transformed(at)]
    if rng.random() < 0.7:
        size = (wide * 0.5, tall * 0.4)
        name = prints.nameplate(rng, color, (24, 64))
        face = camera_parts.panel(size, name).transformed(shift(middle, height + tall * 0.4, deep / 2 + 0.003))
        parts.append(face)
    if rng.random() < 0.6:
        shoe = textures.solid(colors.metal(rng) * 0.7)
        rail = slab(rounded_rectangle(0.12, 0.12, 0.01), 0.0, 0.02, 0.003, (shoe, shoe, shoe))
        parts += [part.transformed(shift(middle, height + tall - 0.015, -deep * 0.1)) for part in rail]
    if rng.random() < 0.12:
        flash = textures.solid(colors.black(rng))
        lamp = slab(rounded_rectangle(0.2, 0.18, 0.03), 0.0, 0.3, 0.02, (flash, flash, flash))
        parts += [part.transformed(shift(middle, height + tall, 0)) for part in lamp]
        window = camera_parts.panel((0.16, 0.1), textures.solid(colors.white(rng)))
        parts.append(window.transformed(shift(middle, height + tall + 0.2, 0.093)))
    return parts


def _grip(rng: np.random.Generator, height: float, depth: float, color: np.ndarray) -> list[Mesh]:
    """A grip for the right hand, which is at −x when the front is at +z."""
    wide, deep = rng.uniform(0.14, 0.22), depth + rng.uniform(0.06, 0.24)
    skin = textures.speckle(rng, color, (64, 64))
    cap = textures.solid(color)
    parts = slab(rounded_rectangle(wide, deep, 0.07), 0.0, height * rng.uniform(0.88, 1.02), 0.03, (cap, skin, cap))
    return [part.transformed(shift(-0.5 + wide / 2, 0.0, (deep - depth) / 2)) for part in parts]
