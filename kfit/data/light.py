"""Light on drawn objects: lamps that are fixed in the object's frame, and the colours that they give to a surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kfit.core.arguments import check_arguments


@dataclass(frozen=True)
class Light:
    """Light fixed in the object's frame, so that all views of one object agree and a code can explain the shading.

    ``ambient`` (3,) is the light from all sides (a quarter stronger from above, weaker from below), ``directions``
    (L, 3) unit vectors that point to the lamps, ``colors`` (L, 3) their RGB strengths, ``specular`` the strength and
    ``shininess`` the exponent of Blinn–Phong highlights.

    Example:
        >>> import numpy as np
        >>> from kfit.data import Light
        >>> Light.random(np.random.default_rng(0)).directions.shape[1]
        3
    """

    ambient: np.ndarray
    directions: np.ndarray
    colors: np.ndarray
    specular: float = 0.0
    shininess: float = 30.0

    def __post_init__(self) -> None:
        check_arguments(Light, vars(self), specular=(0,), shininess=(0,))

    @staticmethod
    def random(rng: np.random.Generator) -> Light:
        """Draw a random room: a main lamp and often a weaker one, warm or cold, with a random ambient fraction.

        The lamps of two rooms in three are above the upright object; the others' are on any side of it, as a lying or
        inverted object has them.
        """
        tint = 1 + rng.normal(0, 0.05) * np.array([1.0, 0.1, -1.0])
        level = rng.uniform(0.58, 0.95)
        share = rng.uniform(0.45, 0.8)
        strengths = np.array([1.0, rng.uniform(0, 0.6)])
        elevation = np.deg2rad([rng.uniform(30, 85), rng.uniform(0, 60)])
        if rng.random() < 1 / 3:
            elevation = np.arcsin(rng.uniform(-1, 1, 2))
        azimuth = rng.uniform(0, 2 * np.pi, 2)
        directions = np.stack(
            [np.cos(elevation) * np.sin(azimuth), np.sin(elevation), np.cos(elevation) * np.cos(azimuth)], axis=1
        )
        return Light(
            ambient=level * share * tint,
            directions=directions,
            colors=level * (1 - share) * 1.5 * strengths[:, None] * tint,
            specular=float(rng.uniform(0, 0.35) * (rng.random() < 0.8)),
            shininess=float(np.exp(rng.uniform(np.log(8), np.log(80)))),
        )

    def shade(self, albedo: np.ndarray, normal: np.ndarray, view: np.ndarray, exposure: np.ndarray) -> np.ndarray:
        """Return the colour (…, 3) of surface points that face the viewer.

        ``c = a·e·(A·(1 + n_y/4) + Σ_l C_l·max(0, n·d_l)) + e²·k·Σ_l C_l·max(0, n·h_l)^s`` with albedo ``a``, exposure
        ``e``, ambient ``A``, lamps ``C_l, d_l`` and half vectors ``h_l``; ``n`` is turned to the viewer first, so that
        both sides of a wall are lit.
        """
        normal = np.where((normal * view).sum(-1, keepdims=True) < 0, -normal, normal)
        light = np.asarray(self.ambient, np.float32) * (1 + normal[..., 1:2] / 4)
        gloss = np.zeros_like(normal)
        for direction, color in zip(self.directions.astype(np.float32), self.colors.astype(np.float32), strict=True):
            light = light + color * np.maximum(normal @ direction, 0)[..., None]
            if self.specular > 0:
                half = view + direction
                half /= np.maximum(np.linalg.norm(half, axis=-1, keepdims=True), 1e-6)
                highlight = np.maximum((normal * half).sum(-1), 0) ** self.shininess
                gloss = gloss + color * highlight[..., None]
        exposure = exposure[..., None]
        shaded: np.ndarray = albedo * light * exposure + self.specular * 2 * gloss * exposure**2
        return shaded.clip(0, 1)
