"""Families of bottles: wine to washing-up liquid, flasks, jugs, sprays, jars of pills and tubes that stand on a cap."""

from __future__ import annotations

from dataclasses import dataclass

Span = tuple[float, float]


@dataclass(frozen=True)
class Form:
    """A family: radius at rising heights (both 0 to 1), body height over width, depth over width, section and tops.

    ``profile`` runs from the foot to where the top begins; ``section`` is "round", "oval" or "square". ``label`` is
    where a label may be, as shares of the height. ``base`` is what it stands on: "ring", "punt", "petals" or "cap".
    ``handle`` is "", "side" for one with a hole through the body, or "loop" for a small one at the neck. ``flatten``
    is how much of the depth is gone at the upper end, and ``tone`` what the body is made of: "glass", "clear",
    "steel" or "any".
    """

    profile: tuple[Span, ...]
    height: Span
    section: str
    tops: tuple[str, ...]
    depth: Span = (1.0, 1.0)
    label: Span = (0.15, 0.65)
    base: str = "ring"
    handle: str = ""
    flatten: float = 0.0
    tone: str = "any"


SHAPES = {
    "wine": Form(
        ((1, 0), (1, 0.3), (1, 0.58), (0.85, 0.66), (0.36, 0.76), (0.33, 1)),
        (3.2, 4.2),
        "round",
        ("cork", "cork", "screw", "open"),
        base="punt",
        tone="glass",
    ),
    "beer": Form(
        ((1, 0), (1, 0.3), (1, 0.52), (0.82, 0.62), (0.42, 0.78), (0.38, 1)),
        (3.0, 3.9),
        "round",
        ("crown", "crown", "open"),
        tone="glass",
    ),
    "water": Form(
        ((0.96, 0), (1, 0.2), (0.93, 0.4), (1, 0.55), (0.98, 0.68), (0.6, 0.88), (0.36, 1)),
        (2.6, 3.6),
        "round",
        ("screw", "screw", "open"),
        base="petals",
        tone="clear",
    ),
    "soda": Form(
        ((0.9, 0), (1, 0.12), (1, 0.35), (0.92, 0.45), (1, 0.58), (0.96, 0.72), (0.55, 0.92), (0.27, 1)),
        (2.7, 3.3),
        "round",
        ("screw",),
        label=(0.4, 0.7),
        base="petals",
        tone="clear",
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
        ((0.93, 0), (1, 0.15), (0.88, 0.55), (0.98, 0.75), (0.85, 1)), (2.0, 2.8), "round", ("spout", "screw", "loop")
    ),
    "tube": Form(((0.97, 0), (1, 0.1), (1, 0.6), (1, 0.95), (0.9, 1)), (2.4, 3.4), "round", ("wide",)),
    "spray": Form(
        ((0.97, 0), (1, 0.15), (1, 0.5), (0.94, 0.66), (0.5, 0.84), (0.32, 0.92), (0.32, 1)),
        (2.0, 2.6),
        "oval",
        ("trigger",),
        (0.5, 0.75),
        label=(0.12, 0.6),
    ),
    "round_spray": Form(
        ((0.97, 0), (1, 0.2), (1, 0.58), (0.82, 0.74), (0.4, 0.88), (0.34, 1)),
        (2.0, 2.7),
        "round",
        ("trigger",),
        label=(0.12, 0.55),
    ),
    "squeeze": Form(
        ((0.92, 0), (1, 0.16), (1, 0.45), (0.93, 0.75), (0.8, 0.94), (0.5, 1)),
        (1.9, 2.5),
        "oval",
        ("none",),
        (0.5, 0.7),
        label=(0.25, 0.75),
        base="cap",
    ),
    "lotion": Form(
        ((0.72, 0), (0.8, 0.2), (0.9, 0.5), (0.97, 0.8), (1, 0.97), (1, 1)),
        (2.2, 3.0),
        "oval",
        ("none",),
        (0.55, 0.75),
        label=(0.3, 0.85),
        base="cap",
        flatten=0.9,
    ),
    "jug": Form(
        ((0.97, 0), (1, 0.15), (1, 0.5), (0.9, 0.7), (0.5, 0.9), (0.36, 1)),
        (1.7, 2.1),
        "square",
        ("screw", "wide"),
        (0.75, 1.0),
        label=(0.1, 0.4),
        handle="side",
    ),
    "detergent": Form(
        ((0.96, 0), (1, 0.12), (1, 0.55), (0.92, 0.8), (0.6, 0.94), (0.36, 1)),
        (1.6, 2.0),
        "oval",
        ("wide", "flip"),
        (0.5, 0.65),
        label=(0.12, 0.5),
        handle="side",
    ),
    "growler": Form(
        ((0.92, 0), (1, 0.12), (1, 0.5), (0.8, 0.68), (0.4, 0.82), (0.3, 0.88), (0.3, 1)),
        (1.7, 2.2),
        "round",
        ("screw", "cork", "open"),
        handle="loop",
        tone="glass",
    ),
    "flat": Form(
        ((0.98, 0), (1, 0.1), (1, 0.6), (0.9, 0.78), (0.4, 0.9), (0.34, 1)),
        (1.9, 2.6),
        "oval",
        ("screw", "wide"),
        (0.32, 0.5),
        tone="glass",
    ),
    "long_neck": Form(
        ((0.98, 0), (1, 0.1), (1, 0.38), (0.75, 0.48), (0.36, 0.58), (0.3, 0.75), (0.28, 1)),
        (3.2, 4.4),
        "round",
        ("screw", "cork", "open", "nozzle"),
        label=(0.05, 0.38),
        tone="glass",
    ),
    "oil": Form(
        ((1, 0), (1, 0.2), (1, 0.6), (0.85, 0.68), (0.36, 0.76), (0.32, 1)),
        (3.0, 4.0),
        "square",
        ("screw", "cork", "open"),
        (0.9, 1.0),
        tone="glass",
    ),
    "milk": Form(
        ((0.95, 0), (1, 0.08), (1, 0.5), (0.9, 0.62), (0.62, 0.78), (0.56, 1)),
        (2.3, 2.9),
        "round",
        ("wide", "open", "screw"),
        tone="clear",
    ),
    "thermos": Form(
        ((0.98, 0), (1, 0.04), (1, 0.5), (1, 0.82), (0.85, 0.92), (0.68, 1)),
        (2.8, 3.8),
        "round",
        ("wide", "loop", "loop"),
        tone="steel",
    ),
    "dropper": Form(
        ((0.96, 0), (1, 0.06), (1, 0.6), (0.95, 0.78), (0.5, 0.93), (0.42, 1)),
        (1.5, 2.1),
        "round",
        ("dropper", "screw"),
        tone="glass",
    ),
    "pills": Form(
        ((0.96, 0), (1, 0.06), (1, 0.6), (0.98, 0.85), (0.8, 0.95), (0.76, 1)),
        (1.35, 1.9),
        "round",
        ("wide",),
        label=(0.1, 0.75),
    ),
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
        base="punt",
    ),
    "champagne": Form(
        ((1, 0), (1, 0.25), (0.97, 0.45), (0.75, 0.62), (0.48, 0.78), (0.36, 1)),
        (3.1, 3.7),
        "round",
        ("cork",),
        label=(0.15, 0.45),
        base="punt",
        tone="glass",
    ),
    "dish": Form(
        ((0.96, 0), (1, 0.12), (0.9, 0.32), (0.78, 0.5), (0.84, 0.66), (0.7, 0.86), (0.36, 1)),
        (2.3, 2.9),
        "oval",
        ("pull",),
        (0.5, 0.7),
        label=(0.1, 0.5),
    ),
    "mister": Form(
        ((0.98, 0), (1, 0.04), (1, 0.6), (0.98, 0.9), (0.7, 0.97), (0.5, 1)), (2.2, 3.2), "round", ("mist",)
    ),
    "kettle": Form(
        ((0.9, 0), (1, 0.1), (0.96, 0.4), (0.84, 0.68), (0.56, 0.9), (0.42, 1)),
        (1.8, 2.2),
        "round",
        ("wide", "screw"),
        label=(0.1, 0.35),
        handle="side",
    ),
    "hourglass_spray": Form(
        ((1, 0), (0.98, 0.12), (0.8, 0.4), (0.84, 0.62), (0.6, 0.84), (0.34, 0.94), (0.34, 1)),
        (2.2, 2.7),
        "square",
        ("trigger",),
        (0.6, 0.8),
        label=(0.1, 0.5),
    ),
}
