"""What a camera shows from behind, from its sides and from below, built with the front at +z, and its strap."""

from __future__ import annotations

import numpy as np

from kfit.data.mesh import Mesh
from kfit.data.shapes import colors, laptop_faces, prints, textures, undersides
from kfit.data.shapes.camera_parts import panel
from kfit.data.shapes.placing import shift, turn_x, turn_y
from kfit.data.shapes.primitives import circle, plate, revolve, rounded_rectangle, slab, smooth, tube

LIFT = 0.004
"""How far in front of the body's faces panels lie, so that they cover them."""


def rear(
    rng: np.random.Generator, height: float, depth: float, base: np.ndarray, screen: float, eye: float | None
) -> list[Mesh]:
    """A display with its buttons, or a film camera's back; and an eyepiece, where ``eye`` gives its height.

    Args:
        rng: Source of randomness.
        height, depth: Of the body, whose width is 1.
        base: The body's colour.
        screen: Chance of a display.
        eye: Height of the eyepiece's middle.
    """
    z = depth / 2 + LIFT
    parts = _display(rng, height, z, base) if rng.random() < screen else _film_back(rng, height, z, base)
    if eye is not None:
        rubber = textures.solid(colors.black(rng))
        tall = rng.uniform(0.03, 0.08)
        cup = slab(rounded_rectangle(0.2, 0.13, 0.04), 0.0, tall, 0.012, (rubber, rubber, rubber))
        glass = panel((0.1, 0.06), textures.solid(np.array([0.12, 0.13, 0.17])))
        parts += [part.transformed(shift(0, eye, z - 0.01) @ turn_x(np.pi / 2)) for part in cup]
        parts.append(glass.transformed(shift(0, eye, z + tall - 0.008)))
    return [part.transformed(turn_y(np.pi)) for part in parts]


def _display(rng: np.random.Generator, height: float, z: float, base: np.ndarray) -> list[Mesh]:
    """A display at the left, flush or on a hinge, and a pad, a dial and buttons for the right thumb."""
    wide, tall = rng.uniform(0.48, 0.66), height * rng.uniform(0.55, 0.76)
    kind = rng.random()
    show = laptop_faces.off if kind < 0.55 else prints.photo if kind < 0.8 else laptop_faces.windows
    picture = laptop_faces.framed(rng, show(rng, base, (80, 112)), colors.black(rng))
    left, middle = -0.47 + wide / 2, height * rng.uniform(0.4, 0.46)
    thick = rng.uniform(0.01, 0.035) if rng.random() < 0.5 else LIFT / 2
    edge = textures.solid(colors.black(rng))
    frame = slab(rounded_rectangle(wide, tall, 0.02), 0.0, thick, thick / 3, (picture, edge, edge))
    parts = [part.transformed(shift(left, middle, z - LIFT / 2) @ turn_x(np.pi / 2)) for part in frame]
    room = 0.47 - (left + wide / 2)
    column = 0.47 - room / 2
    dark = textures.solid(np.clip(base * 0.6 + 0.08, 0, 1))
    pad, at = min(room * 0.38, 0.1), height * rng.uniform(0.28, 0.42)
    for radius, rise, tile in ((pad, 0.012, dark), (pad * 0.45, 0.016, textures.solid(colors.metal(rng) * 0.8))):
        knob = [
            revolve(np.array([(radius, 0.0), (radius * 0.95, rise)]), tile, 20),
            plate(circle(20) * radius * 0.95, rise, tile, num_rings=2),
        ]
        parts += [part.transformed(shift(column, at, z - LIFT) @ turn_x(np.pi / 2)) for part in knob]
    for _ in range(rng.integers(2, 6)):
        size = (min(room * 0.3, 0.06), 0.03)
        place = (column + rng.choice([-0.25, 0.25]) * room, height * rng.choice([0.12, 0.16, 0.55, 0.63]))
        parts.append(panel(size, dark).transformed(shift(*place, z)))
    if rng.random() < 0.6:
        rubber = textures.solid(colors.black(rng) + 0.03)
        rest = slab(rounded_rectangle(room * 0.7, height * 0.22, 0.03), 0.0, 0.03, 0.015, (rubber, rubber, rubber))
        parts += [part.transformed(shift(column, height * 0.8, z - 0.008) @ turn_x(np.pi / 2)) for part in rest]
    if rng.random() < 0.5:
        name = prints.nameplate(rng, base, (16, 64))
        parts.append(panel((0.16, 0.03), name).transformed(shift(left, min(middle + tall / 2 + 0.03, height * 0.9), z)))
    return parts


def _film_back(rng: np.random.Generator, height: float, z: float, base: np.ndarray) -> list[Mesh]:
    """A hinged door with a film window, a pocket for a card, or small print."""
    leather = textures.speckle(rng, base if rng.random() < 0.5 else colors.black(rng), (64, 128))
    parts = [panel((0.76, height * 0.6), leather).transformed(shift(0, height * 0.45, z))]
    if rng.random() < 0.6:
        window = textures.solid(colors.hue(rng, None, (0.1, 0.6), (0.15, 0.8)))
        parts.append(panel((0.05, height * 0.3), window).transformed(shift(0.24, height * 0.45, z + LIFT)))
    if rng.random() < 0.5:
        card = laptop_faces.framed(rng, prints.label(rng, base, (48, 64)), base * 0.7)
        parts.append(panel((0.3, height * 0.36), card).transformed(shift(-0.1, height * 0.42, z + LIFT)))
    view = textures.solid(np.array([0.06, 0.06, 0.08]))
    parts.append(panel((0.1, 0.06), view).transformed(shift(rng.uniform(-0.35, 0.1), height * 0.88, z)))
    return parts


def below(rng: np.random.Generator, half: float, depth: float, base: np.ndarray) -> list[Mesh]:
    """A tripod socket, a battery's door and small print on an underside that is flat to ``half`` on either side."""
    ring = textures.solid(colors.metal(rng))
    middle = rng.uniform(-0.15, 0.15)
    parts = [
        plate(circle(20) * 0.055, -LIFT, ring, facing=-1, num_rings=2),
        plate(circle(16) * 0.038, -1.5 * LIFT, textures.solid(np.full(3, 0.03)), facing=-1, num_rings=2),
    ]
    parts = [part.transformed(shift(middle, 0, 0)) for part in parts]
    shade = np.clip(base * rng.choice([0.75, 1.2]) + 0.02, 0, 1)
    door = laptop_faces.framed(rng, textures.solid(shade).repeat(8, 0).repeat(12, 1), base * 0.4)
    size = (half * rng.uniform(0.45, 0.7), depth * rng.uniform(0.5, 0.75))
    # The right hand's grip, which holds the battery, is at -x.
    outline = rounded_rectangle(*size, 0.02)
    parts.append(
        plate(outline, -LIFT, door, facing=-1, num_rings=2).transformed(shift(size[0] / 2 - 0.95 * half, 0, 0))
    )
    if rng.random() < 0.7:
        label = undersides.stamp(rng, base if rng.random() < 0.6 else colors.grey(rng))
        side = plate(rounded_rectangle(half * 0.5, depth * 0.45, 0.01), -LIFT, label, facing=-1, num_rings=2)
        parts.append(side.transformed(shift(half * 0.65, 0, 0)))
    return parts


def sides(rng: np.random.Generator, height: float, depth: float, base: np.ndarray) -> list[Mesh]:
    """Lugs for a strap, a cover over the sockets, and on some a strap."""
    parts: list[Mesh] = []
    if rng.random() < 0.6:
        cover = textures.solid(np.clip(base * 0.7 + 0.03, 0, 1))
        door = panel((depth * 0.4, height * 0.45), cover).transformed(turn_y(np.pi / 2))
        parts.append(door.transformed(shift(0.5 + LIFT, height * 0.45, 0)))
    metal = textures.solid(colors.metal(rng) * 0.9)
    for side in (-1, 1):
        lug = tube(np.array([(0.0, -0.025, 0.0), (0.0, 0.0, 0.0), (0.0, 0.025, 0.0)]), [0.014, 0.03], metal, 8)
        parts.append(lug.transformed(shift(side * 0.505, height * 0.85, 0)))
    if rng.random() < 0.3:
        parts += _strap(rng, height, depth)
    return parts


def _strap(rng: np.random.Generator, height: float, depth: float) -> list[Mesh]:
    """A neck strap that falls along both sides and lies behind the camera, or a cord at the right hand."""
    color = colors.black(rng) if rng.random() < 0.6 else colors.any_color(rng)
    tile = textures.rings(rng, color, (64, 16)) if rng.random() < 0.3 else textures.solid(color)
    wide = rng.uniform(0.02, 0.05)
    if rng.random() < 0.35:
        swing = rng.uniform(-0.1, 0.1)
        points = [(-0.51, 0.85, 0.0), (-0.525, 0.6, swing), (-0.52, 0.3, swing), (-0.515, 0.1, -swing)]
        path = smooth(np.array(points) * [1, height, depth], 20)
        return [tube(path, [0.012, 0.012], tile, 8)]
    behind = -depth / 2 - rng.uniform(0.05, 0.14)
    low = wide + 0.005
    half = [
        (0.508, 0.85 * height, 0.0),
        (0.525, 0.5 * height, 0.0),
        (0.52, 0.2 * height, behind * 0.5),
        (0.4, low, behind),
    ]
    points = [*half, (0.0, low, behind * rng.uniform(1.0, 1.3)), *[(-x, y, z) for x, y, z in reversed(half)]]
    path = smooth(np.array(points), 60)
    # Along the sides the strap's width points to the back, behind the camera up.
    upright = np.clip((0.52 - np.abs(path[:, 0])) / 0.12, 0, 1)[:, None]
    axis = np.array([0.0, 0.0, 1.0]) * (1 - upright) + np.array([0.0, 1.0, 0.0]) * upright
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    return [tube(path, [0.006, wide], tile, 8, axis)]
