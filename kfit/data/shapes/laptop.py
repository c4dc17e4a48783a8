"""Laptops: a base with a keyboard and a lid with a screen that faces +x, NOCS's side for it; the width lies along z.

In NOCS's CAMERA sample (val/00000/0000, instances 1 and 2) the object coordinates put the lid's top at the least x, the
trackpad's edge at the greatest, the width along z (±0.36) and the user's left hand at +z.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kfit.data.mesh import Mesh, join
from kfit.data.shapes import colors, laptop_faces, laptop_underside, prints, textures
from kfit.data.shapes.placing import FRONT_TO_X, shift, turn_x
from kfit.data.shapes.primitives import revolve, rounded_rectangle, slab


@dataclass(frozen=True)
class Body:
    """Ranges of one family, in widths: depth, thickness of base and lid, corners, taper to the front, hinge inset.

    ``border`` scales the frame around the display, and ``colorful`` is the chance of a bright shell.
    """

    depth: tuple[float, float]
    base: tuple[float, float]
    lid: tuple[float, float]
    corner: tuple[float, float]
    taper: float = 0.0
    inset: tuple[float, float] = (0.0, 0.02)
    border: float = 1.0
    colorful: float = 0.1


SHAPES = {
    "slim": Body((0.66, 0.74), (0.03, 0.045), (0.012, 0.02), (0.02, 0.05)),
    "wedge": Body((0.66, 0.72), (0.04, 0.06), (0.012, 0.02), (0.02, 0.05), taper=0.6),
    "classic": Body((0.66, 0.78), (0.06, 0.1), (0.025, 0.04), (0.015, 0.04)),
    "square": Body((0.76, 0.81), (0.05, 0.12), (0.02, 0.05), (0.01, 0.04)),
    "netbook": Body((0.62, 0.72), (0.06, 0.11), (0.03, 0.05), (0.04, 0.08)),
    "ultrabook": Body((0.66, 0.72), (0.022, 0.035), (0.01, 0.014), (0.02, 0.04), taper=0.3, border=0.5),
    "convertible": Body((0.64, 0.7), (0.03, 0.045), (0.018, 0.026), (0.015, 0.04), border=0.8),
    "chromebook": Body((0.66, 0.74), (0.045, 0.07), (0.02, 0.032), (0.05, 0.09), border=1.2, colorful=0.6),
    "workstation": Body((0.68, 0.76), (0.075, 0.11), (0.025, 0.04), (0.01, 0.03), inset=(0.02, 0.06)),
    "retro": Body((0.74, 0.81), (0.12, 0.18), (0.045, 0.07), (0.01, 0.03), border=2.0),
    "widescreen": Body((0.6, 0.66), (0.03, 0.06), (0.015, 0.025), (0.015, 0.04), border=0.7),
}
HELD_OUT_SHAPES = {
    "gaming": Body((0.68, 0.78), (0.06, 0.09), (0.02, 0.035), (0.005, 0.02), inset=(0.06, 0.12)),
    "rounded": Body((0.66, 0.76), (0.035, 0.07), (0.015, 0.03), (0.09, 0.14), taper=0.3),
    "rugged": Body((0.72, 0.8), (0.13, 0.18), (0.07, 0.1), (0.05, 0.08), border=2.2, inset=(0.02, 0.05)),
    "tablet": Body((0.66, 0.74), (0.014, 0.022), (0.022, 0.032), (0.02, 0.04), border=0.9, inset=(0.0, 0.01)),
}
TEXTURES: dict[str, tuple[textures.Family, float]] = {
    "off": (laptop_faces.off, 2.0),
    "desktop": (laptop_faces.desktop, 1.5),
    "windows": (laptop_faces.windows, 1.5),
    "document": (laptop_faces.document, 1.0),
    "wallpaper": (laptop_faces.wallpaper, 1.0),
}
HELD_OUT_TEXTURES: dict[str, tuple[textures.Family, float]] = {
    "editor": (laptop_faces.editor, 1.0),
    "film": (laptop_faces.film, 1.0),
}
# What covers the lid's back of half of the laptops, of unseen families and of none.
HELD_OUT_COVERS = [textures.blotches]
COVERS = [textures.dots, textures.stripes, textures.checks, textures.marble, textures.wood, prints.photo]
# Share of taught laptops that belong to no family.
FREE = 0.4


def build(rng: np.random.Generator, held_out: bool) -> Mesh:
    """A laptop in body widths, to be normalised by the caller."""
    shapes = HELD_OUT_SHAPES if held_out else SHAPES
    body = shapes[str(rng.choice(list(shapes)))]
    screen = textures.choose(rng, HELD_OUT_TEXTURES if held_out else TEXTURES)
    covers = HELD_OUT_COVERS if held_out else []
    if not held_out and rng.random() < FREE:
        body, covers = _free(rng), COVERS
        screen = laptop_faces.patchwork if rng.random() < 0.4 else screen
    depth, base_height, lid_height = (float(rng.uniform(*span)) for span in (body.depth, body.base, body.lid))
    outline = rounded_rectangle(1.0, depth, float(rng.uniform(*body.corner)))
    shell = colors.hue(rng) if rng.random() < body.colorful else _shell(rng)
    deck = shell if rng.random() < 0.55 else _shell(rng)
    frame = colors.black(rng) if rng.random() < 0.65 else deck
    edge = textures.solid(shell)
    below = laptop_underside.face(rng, shell * rng.uniform(0.3, 1), depth)
    faces = (laptop_faces.deck(rng, deck, depth), edge, below)
    base = join(
        [
            *slab(outline, 0.0, base_height, rng.uniform(0.1, 0.5) * base_height, faces),
            *laptop_underside.feet(rng, depth),
            *laptop_underside.sockets(rng, base_height, depth),
        ]
    )
    # Only the underside climbs towards the front, so the deck stays level.
    sloped = base.vertices.copy()
    share = 1 - sloped[:, 1] / base_height
    sloped[:, 1] += share * body.taper * base_height / depth * (sloped[:, 2] + depth / 2)
    base = Mesh(sloped, base.faces, base.normals, base.uv, base.texture)
    inset = float(rng.uniform(*body.inset))
    lid_depth = depth * rng.uniform(0.94, 1.0) - inset
    lid_outline = rounded_rectangle(1.0, lid_depth, float(rng.uniform(*body.corner)))
    opening = np.deg2rad(_opening_deg(rng))
    front = laptop_faces.screen(rng, screen, frame, lid_depth, body.border)
    faces = (front, edge, laptop_faces.back(rng, shell, lid_depth, covers))
    lid = join(slab(lid_outline, -lid_height, 0.0, rng.uniform(0.2, 0.5) * lid_height, faces))
    gap = lid_height * rng.uniform(0.3, 1.2)
    hinge_z = -depth / 2 + inset + lid_height * 0.5
    lid = lid.transformed(shift(0, 0, -lid_depth / 2 - gap))
    lid = lid.transformed(shift(0, base_height, hinge_z) @ turn_x(np.pi - opening))
    hinge = [part.transformed(shift(0, base_height, hinge_z)) for part in _hinge(rng, gap, lid_height, frame, shell)]
    return join([base, lid, *hinge]).transformed(FRONT_TO_X)


def _free(rng: np.random.Generator) -> Body:
    """A body of no family: thin or thick, sharp or rounded, with a wide or narrow frame."""
    depth, inset = rng.uniform(0.56, 0.88), rng.uniform(0, 0.13) * (rng.random() < 0.5)
    base, lid, corner, border = np.exp(rng.uniform(np.log([0.013, 0.009, 0.005, 0.4]), np.log([0.2, 0.1, 0.15, 2.5])))
    taper = rng.uniform(0, 0.7) * (rng.random() < 0.5)
    return Body((depth, depth), (base, base), (lid, lid), (corner, corner), taper, (inset, inset), border, 0.3)


def _opening_deg(rng: np.random.Generator) -> float:
    """Angle of the hinge: mostly as one works, often any from nearly closed to flat."""
    return float(rng.uniform(6, 180) if rng.random() < 0.4 else np.clip(rng.normal(108, 13), 80, 140))


def _shell(rng: np.random.Generator) -> np.ndarray:
    kinds = (
        colors.metal,
        colors.metal,
        colors.metal,
        colors.black,
        colors.black,
        colors.grey,
        colors.white,
    )
    return kinds[rng.integers(len(kinds))](rng)


def _hinge(rng: np.random.Generator, gap: float, thickness: float, frame: np.ndarray, shell: np.ndarray) -> list[Mesh]:
    """A barrel along the whole back, two short ones, or a bar in the middle, in the hinge's own frame."""
    spans = (((-0.42, 0.42),), ((-0.4, -0.26), (0.26, 0.4)), ((-0.3, 0.3),))[rng.integers(3)]
    radius = max(gap, thickness * 0.5)
    tile = textures.solid(frame if rng.random() < 0.6 else shell * 0.8)
    lying = np.array([[0.0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 1, 0]])
    parts = []
    for start, stop in spans:
        wall = revolve(np.stack([np.full(12, radius), np.linspace(-stop, -start, 12)], axis=1), tile, 12)
        ends = [(np.linspace(0, radius, 3), -stop), (np.linspace(radius, 0, 3), -start)]
        discs = [revolve(np.stack([radii, np.full(3, at)], axis=1), tile, 12) for radii, at in ends]
        parts += [part.transformed(lying) for part in (wall, *discs)]
    return parts
