"""Cameras: a body with lens, hump, grip and dials; the lens points along +x, NOCS's side for it, the width along z.

The CAMERA split's mean box of this category is widest along z (x 0.46, y 0.49, z 0.70), and the vertices of REAL275's
``camera_canon_len_norm.obj`` form a round disc, the lens's front, at its greatest x.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kfit.data.mesh import Mesh, join
from kfit.data.shapes import camera_back, camera_parts, colors, prints, textures
from kfit.data.shapes.placing import FRONT_TO_X, shift, turn_x
from kfit.data.shapes.primitives import rounded_rectangle, slab


@dataclass(frozen=True)
class Form:
    """Ranges in body widths: height, depth, corner radius, the lens's radius over the height and length, its place.

    ``hump`` and ``grip`` are the chances of a prism or flash on top and of a grip, ``screen`` that of a display on the
    back. ``corners`` names the side from which the outline's corners are rounded: "above" or "front".
    """

    height: tuple[float, float]
    depth: tuple[float, float]
    corner: tuple[float, float]
    lens_radius: tuple[float, float]
    lens_length: tuple[float, float]
    lens_place: tuple[float, float]
    hump: float
    grip: float
    screen: float = 0.9
    corners: str = "above"


SHAPES = {
    "compact": Form((0.55, 0.68), (0.18, 0.28), (0.03, 0.12), (0.28, 0.4), (0.04, 0.25), (-0.02, 0.14), 0.1, 0.3),
    "pocket": Form(
        (0.56, 0.64), (0.16, 0.24), (0.04, 0.12), (0.3, 0.42), (0.03, 0.3), (0.02, 0.2), 0.0, 0.2, 1.0, "front"
    ),
    "film_compact": Form(
        (0.52, 0.64), (0.24, 0.36), (0.06, 0.16), (0.22, 0.36), (0.05, 0.22), (-0.06, 0.1), 0.0, 0.3, 0.0, "front"
    ),
    "reflex": Form((0.6, 0.75), (0.3, 0.45), (0.08, 0.16), (0.36, 0.47), (0.3, 0.95), (-0.02, 0.08), 1.0, 1.0),
    "telephoto": Form((0.62, 0.75), (0.3, 0.42), (0.08, 0.16), (0.38, 0.47), (0.9, 1.3), (-0.02, 0.06), 1.0, 1.0),
    "film_reflex": Form(
        (0.55, 0.65), (0.22, 0.34), (0.05, 0.1), (0.36, 0.46), (0.2, 0.55), (-0.03, 0.04), 1.0, 0.1, 0.0
    ),
    "rangefinder": Form((0.5, 0.62), (0.2, 0.3), (0.05, 0.14), (0.3, 0.42), (0.12, 0.4), (-0.04, 0.08), 0.05, 0.1, 0.4),
    "bridge": Form((0.62, 0.8), (0.35, 0.6), (0.08, 0.18), (0.36, 0.46), (0.25, 0.7), (0.0, 0.1), 0.8, 1.0),
    "superzoom": Form((0.66, 0.78), (0.45, 0.62), (0.1, 0.18), (0.38, 0.46), (0.5, 1.0), (0.02, 0.1), 1.0, 1.0),
    "mirrorless": Form((0.55, 0.65), (0.22, 0.34), (0.05, 0.12), (0.36, 0.46), (0.2, 0.7), (0.0, 0.1), 0.45, 0.8),
    "instant_mini": Form(
        (0.95, 1.15), (0.38, 0.55), (0.14, 0.3), (0.2, 0.3), (0.08, 0.24), (-0.06, 0.06), 0.0, 0.35, 0.0, "front"
    ),
    "action": Form(
        (0.66, 0.78), (0.36, 0.5), (0.05, 0.12), (0.22, 0.32), (0.04, 0.1), (0.16, 0.24), 0.0, 0.0, 1.0, "front"
    ),
}
HELD_OUT_SHAPES = {
    "instant": Form((0.75, 1.0), (0.45, 0.65), (0.05, 0.15), (0.22, 0.34), (0.06, 0.2), (-0.05, 0.05), 0.5, 0.0, 0.3),
    "studio": Form((0.95, 1.15), (0.45, 0.6), (0.08, 0.15), (0.26, 0.32), (0.3, 0.9), (-0.02, 0.05), 1.0, 1.0),
    "disposable": Form(
        (0.52, 0.6), (0.22, 0.32), (0.02, 0.06), (0.16, 0.24), (0.02, 0.06), (-0.04, 0.04), 0.0, 0.0, 0.0, "front"
    ),
    "panoramic": Form((0.4, 0.48), (0.2, 0.3), (0.06, 0.12), (0.38, 0.48), (0.15, 0.5), (-0.12, 0.02), 0.2, 0.6),
    "cube": Form((0.8, 1.0), (0.6, 0.8), (0.06, 0.14), (0.28, 0.4), (0.25, 0.7), (-0.04, 0.04), 0.2, 0.4, 0.5),
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
# A third of the taught cameras belong to no family: two forms of wide ranges stand for them, and half have other skins.
FREE = 0.35
FREE_SHAPES = [
    Form((0.4, 1.2), (0.2, 0.8), (0.02, 0.16), (0.15, 0.48), (0.02, longest), (-0.15, 0.25), 0.4, 0.5, 0.7, corners)
    for corners, longest in (("above", 1.0), ("front", 0.3))
]
FREE_TEXTURES = [textures.dots, textures.stripes, textures.checks, textures.marble, textures.speckle, textures.gradient]


def build(rng: np.random.Generator, held_out: bool) -> Mesh:
    """A camera in body widths, to be normalised by the caller."""
    shapes = HELD_OUT_SHAPES if held_out else SHAPES
    name = str(rng.choice(list(shapes)))
    form = shapes[name]
    family = textures.choose(rng, HELD_OUT_TEXTURES if held_out else TEXTURES)
    if not held_out and rng.random() < FREE:
        form = FREE_SHAPES[int(rng.integers(2))]
        family = FREE_TEXTURES[int(rng.integers(len(FREE_TEXTURES)))] if rng.random() < 0.5 else family
    height, depth, corner = (float(rng.uniform(*span)) for span in (form.height, form.depth, form.corner))
    base = _body_color(rng, name)
    top = base if rng.random() < 0.7 else colors.metal(rng)
    parts = _body(rng, form, family, (height, depth, corner), base, top)
    radius = height * rng.uniform(*form.lens_radius)
    length = float(rng.uniform(*form.lens_length))
    place = (float(rng.uniform(*form.lens_place)), float(height * rng.uniform(0.44, 0.52)), depth / 2)
    trim = base if rng.random() < 0.6 else colors.metal(rng)
    parts += [part.transformed(shift(*place)) for part in camera_parts.lens(rng, radius, length, trim)]
    humped = rng.random() < form.hump
    if humped:
        parts += _hump(rng, place[0], height, depth, base)
    straight = form.corners == "above" or corner < 0.1
    if rng.random() < form.grip and straight:
        parts += _grip(rng, height, depth, base if rng.random() < 0.5 else colors.black(rng))
    if straight:
        parts += camera_parts.controls(rng, height, depth, colors.metal(rng) if rng.random() < 0.5 else base * 0.8)
    parts += camera_parts.front(rng, height, depth, place[0] + radius, base)
    eye = height + 0.04 if humped else height * 0.9 if rng.random() < 0.3 else None
    parts += camera_back.rear(rng, height, depth, base, form.screen, eye)
    parts += camera_back.below(rng, 0.46 if form.corners == "above" else 0.47 - min(corner, 0.4 * height), depth, base)
    parts += camera_back.sides(rng, height, depth, base)
    return join(parts).transformed(FRONT_TO_X)


def _body(
    rng: np.random.Generator,
    form: Form,
    family: textures.Family,
    size: tuple[float, float, float],
    base: np.ndarray,
    top: np.ndarray,
) -> list[Mesh]:
    """The body of a height, depth and corner radius, its corners rounded as seen from above or from the front."""
    height, depth, corner = size
    bevel = rng.uniform(0.02, 0.06)
    if form.corners == "above":
        tiles = (textures.solid(top), family(rng, base, (160, 448)), textures.solid(base * 0.8))
        return slab(rounded_rectangle(1.0, depth, corner), 0.0, height, bevel, tiles)
    tiles = (family(rng, base, (160, 256)), textures.solid(top), textures.solid(base * 0.9))
    outline = rounded_rectangle(1.0, height, min(corner, 0.4 * height))
    standing = shift(0, height / 2, 0) @ turn_x(np.pi / 2)
    return [part.transformed(standing) for part in slab(outline, -depth / 2, depth / 2, bevel * 1.5, tiles)]


def _body_color(rng: np.random.Generator, name: str) -> np.ndarray:
    """Mostly black or silver; compact and instant cameras come in any colour."""
    if rng.random() < (0.5 if name in ("compact", "instant", "pocket", "instant_mini", "disposable") else 0.08):
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
