"""Bottles: lofted bodies of round, oval or square section with necks, handles, tops, labels and undersides."""

from __future__ import annotations

import numpy as np

from kfit.data.mesh import Mesh, join
from kfit.data.shapes import bottle_tops, colors, prints, textures, undersides
from kfit.data.shapes.bottle_forms import HELD_OUT_SHAPES, SHAPES, Form
from kfit.data.shapes.placing import turn_y
from kfit.data.shapes.primitives import circle, plate, revolve, rounded_rectangle, sheet, smooth, tube

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
# Share of taught bottles whose shape belongs to no family, and of those whose pattern belongs to none.
FREE = 0.35
FREE_TOPS = sorted({top for form in SHAPES.values() for top in form.tops if top != "none"})


def build(rng: np.random.Generator, held_out: bool) -> Mesh:
    """A bottle in body widths, to be normalised by the caller. An oval or square one is wide along z, NOCS's side."""
    shapes = HELD_OUT_SHAPES if held_out else SHAPES
    form = shapes[str(rng.choice(list(shapes)))]
    family = textures.choose(rng, HELD_OUT_TEXTURES if held_out else TEXTURES)
    if not held_out and rng.random() < FREE:
        form = _free(rng)
    if not held_out and rng.random() < FREE:
        family = textures.mixed
    height = float(rng.uniform(*form.height))
    base = _body_color(rng, form.tone)
    section = _section(rng, form)
    profile = _profile(rng, form, shapes, height, blended=not held_out)
    neck = float(profile[-1, 0])
    skin = family(rng, base, (256, 384))
    body = _loft(profile, section, neck, skin, form.flatten)
    label = (rng.random() < 0.7 and not held_out) or (held_out and rng.random() < 0.4)
    parts = [body]
    if form.handle == "side":
        # A label would bridge the hole, so it stays below.
        parts = [_pinched(body, height), _side_handle(rng, height, base)]
    elif form.handle == "loop":
        parts.append(_loop_handle(rng, profile, height, base))
    if label:
        parts.append(_label(rng, form, profile, section, height, base))
    parts += _base(rng, form, profile, section, base)
    if form.tops == ("none",):
        end = body.vertices.reshape(len(profile), -1, 3)[-1][:, [0, 2]]
        parts.append(plate(end, height, textures.solid(base)))
        return join(parts)
    top = bottle_tops.build(rng, str(rng.choice(form.tops)), neck, height, base)
    if form.section != "round" and rng.random() < 0.7:  # a spray's head lies in the plane of the wide face
        top = [part.transformed(turn_y(-np.pi / 2)) for part in top]
    return join(parts + top)


def _free(rng: np.random.Generator) -> Form:
    """A bottle of no family: straight or waisted, with a shoulder and a neck of any height and width, and any top."""
    shoulder, neck = rng.uniform(0.35, 0.9), rng.uniform(0.26, 0.8)
    waist, narrowing = rng.uniform(0.75, 1.0), shoulder + (1 - shoulder) * rng.uniform(0.25, 0.9)
    profile = (
        (rng.uniform(0.7, 1.0), 0.0),
        (1.0, shoulder * rng.uniform(0.1, 0.3)),
        (waist if rng.random() < 0.5 else 1.0, shoulder * rng.uniform(0.45, 0.8)),
        (rng.uniform(0.85, 1.0), shoulder),
        (neck * rng.uniform(1.0, 1.2), narrowing),
        (neck, 1.0),
    )
    section = str(rng.choice(["round", "oval", "square"]))
    height, depth = float(np.exp(rng.uniform(np.log(1.3), np.log(4.4)))), float(rng.uniform(0.32, 1.0))
    return Form(
        profile,
        (height, height),
        section,
        (str(rng.choice(FREE_TOPS)),),
        (1.0, 1.0) if section == "round" else (depth, depth),
        label=(0.15, shoulder),
        base=str(rng.choice(["ring", "punt", "petals"])),
        tone=str(rng.choice(["any", "glass", "clear", "steel"])),
    )


def _body_color(rng: np.random.Generator, tone: str) -> np.ndarray:
    """Dark or green glass, clear plastic, white plastic, steel, or any colour."""
    kind = rng.random()
    if tone == "steel" and kind < 0.45:
        return colors.metal(rng)
    if kind < (0.7 if tone == "glass" else 0.12):
        return colors.hue(rng, float(rng.uniform(0.06, 0.4)), (0.3, 0.9), (0.06, 0.4))
    if kind < (0.6 if tone == "clear" else 0.2 if tone == "any" else 0.85):
        return colors.hue(rng, float(rng.uniform(0.4, 0.62)), (0.03, 0.2), (0.65, 0.92))
    if kind < (0.7 if tone == "clear" else 0.5):
        return colors.white(rng)
    return colors.any_color(rng, whites=0.1)


def _section(rng: np.random.Generator, form: Form) -> np.ndarray:
    """Closed outline whose half width along z is 1."""
    depth = float(rng.uniform(*form.depth))
    if form.section == "square":
        return rounded_rectangle(2 * depth, 2.0, rng.uniform(0.15, 0.6) * depth, 12)
    oval: np.ndarray = circle(48) * [depth, 1.0]
    return oval


def _profile(rng: np.random.Generator, form: Form, shapes: dict[str, Form], height: float, blended: bool) -> np.ndarray:
    """Radius and height from the rounded foot up; two in five of training are part-way to another family's."""
    controls = np.array(form.profile) * [0.5, 1.0]
    curve = smooth(controls * (1 + rng.normal(0, 0.025, (len(controls), 1)) * [1, 0]), 56)
    if blended and rng.random() < 0.4 and form.base != "cap" and not form.handle:
        others = [other for other in shapes.values() if other.section == form.section and other.base != "cap"]
        other = smooth(np.array(others[rng.integers(len(others))].profile) * [0.5, 1.0], 56)
        curve = curve + rng.uniform(0.1, 0.5) * (other - curve)
    curve[:, 0] *= 0.5 / curve[:, 0].max()
    curve[:, 1] = height * curve[:, 1].clip(0, 1)
    corner = rng.uniform(0.02, 0.08)
    lifted = np.clip(1 - curve[:, 1] / corner, 0, 1)
    curve[:, 0] -= corner * 0.7 * (1 - np.sqrt(1 - lifted**2))
    return curve


def _loft(profile: np.ndarray, section: np.ndarray, neck: float, texture: np.ndarray, flatten: float) -> Mesh:
    """The body, whose section becomes a circle as it narrows to the neck; without narrowing it stays."""
    angle = np.arctan2(section[:, 0], section[:, 1])
    round_section = np.stack([np.sin(angle), np.cos(angle)], axis=1)
    width = float(profile[:, 0].max())
    top = np.arange(len(profile)) > int(np.argmax(profile[:, 0] > 0.97 * width))
    share = np.clip((0.9 * width - profile[:, 0]) / max(0.9 * width - neck, 1e-3), 0, 1) * top
    blended = section[None] + (round_section - section)[None] * (share * (flatten == 0))[:, None, None]
    flat = 1 - flatten * (profile[:, 1] / profile[-1, 1]) ** 1.5
    x, z = profile[:, :1] * blended[..., 0] * flat[:, None], profile[:, :1] * blended[..., 1]
    return sheet(np.stack([x, np.broadcast_to(profile[:, 1:], x.shape), z], axis=-1), texture)


def _pinched(body: Mesh, height: float) -> Mesh:
    """The body with its +z side drawn in where a hand reaches through."""
    y, z = body.vertices[:, 1] / height, body.vertices[:, 2]
    bump = np.clip((y - 0.38) / 0.1, 0, 1) * np.clip((0.95 - y) / 0.12, 0, 1)
    moved = body.vertices.copy()
    moved[:, 2] = np.where(z > 0, z * (1 - 0.55 * bump), z)
    grid = moved.reshape(56, -1, 3)
    return sheet(grid, body.texture)


def _side_handle(rng: np.random.Generator, height: float, color: np.ndarray) -> Mesh:
    """The grip of a jug, from its belly up to its shoulder, on the +z side."""
    reach = 0.5 - rng.uniform(0.07, 0.1)
    heights = np.array([0.34, 0.42, 0.55, 0.68, 0.8, 0.88]) * height
    out = np.array([reach * 0.8, reach, reach, reach * 0.96, reach * 0.7, 0.12])
    path = smooth(np.stack([out, heights, np.zeros(6)], axis=1), 20)
    grip = tube(path, [rng.uniform(0.06, 0.085), rng.uniform(0.07, 0.11)], textures.solid(color), 14)
    return grip.transformed(turn_y(-np.pi / 2))


def _loop_handle(rng: np.random.Generator, profile: np.ndarray, height: float, color: np.ndarray) -> Mesh:
    """A small ring from the neck to the shoulder, along +z."""
    low, high = height * rng.uniform(0.68, 0.74), height * rng.uniform(0.92, 0.97)
    inner = np.interp([low, high], profile[:, 1], profile[:, 0])
    reach = rng.uniform(0.38, 0.46)
    corners = [(inner[0] * 0.95, low), (reach, (2 * low + high) / 3), (reach * 0.95, high), (inner[1] * 0.8, high)]
    path = smooth(np.array([(*corner, 0.0) for corner in corners]), 18)
    ring = tube(path, [0.035, rng.uniform(0.035, 0.06)], textures.solid(color), 10)
    return ring.transformed(turn_y(-np.pi / 2))


def _base(
    rng: np.random.Generator, form: Form, profile: np.ndarray, section: np.ndarray, color: np.ndarray
) -> list[Mesh]:
    """What it stands on."""
    radius = float(profile[0, 0])
    if form.base == "cap":
        cap = colors.any_color(rng, whites=0.5)
        tile, tall = textures.solid(cap), rng.uniform(0.2, 0.45)
        wide = radius * rng.uniform(0.8, 1.02)
        side = np.array([(wide, -tall), (wide, -tall / 2), (wide * 0.98, 0.0)])
        under = undersides.standing_ring(rng, wide, -tall, 0.03, (cap, cap * 0.8), section, 0.15)
        shoulder = np.array([(wide * 0.98, 0.0), (radius, 0.001)])
        return [revolve(side, tile, section=section), revolve(shoulder, tile, section=section), *under]
    if form.base == "petals" and rng.random() < 0.7:
        return undersides.petals(radius, 0.0, 0.1, color * 0.9, int(rng.integers(5, 7)))
    deep = form.base == "punt" and rng.random() < 0.8
    depth, dome = (0.04, rng.uniform(0.08, 0.3)) if deep else (rng.uniform(0.01, 0.04), rng.choice([0.0, 0.0, 0.03]))
    width = rng.uniform(0.08, 0.25)
    return undersides.standing_ring(rng, radius, 0.0, depth, (color * 0.95, color * 0.8), section, width, float(dome))


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
    stop = min(stop, height * 0.36) if form.handle == "side" else stop
    stop = max(min(stop, float(wide.max())), start + 0.1 * height)
    rows = np.linspace(start, stop, 14)
    radius = np.interp(rows, profile[:, 1], profile[:, 0])[:, None] + 0.01
    flat = 1 - form.flatten * (rows / height)[:, None] ** 1.5
    x = radius * section[:, 0] * flat + 0.01 * np.sign(section[:, 0]) * (1 - flat)
    points = np.stack([x, np.broadcast_to(rows[:, None], x.shape), radius * section[:, 1]], axis=-1)
    return sheet(points, prints.label(rng, base, (160, 448)))
