"""A textured triangle mesh, and joining parts into one mesh with one texture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

# Width of the border that repeats a tile's edge colours, so that bilinear look-ups never mix neighbouring tiles.
_MARGIN = 2


@dataclass(frozen=True)
class Mesh:
    """Triangles with normals, texture coordinates and one texture.

    Vertices are duplicated at creases and texture seams, so every vertex has one normal and one texture coordinate.
    Texture coordinates are (column, row) from the texture's upper left corner, in [0, 1]: (0, 0) is the outer corner of
    the first texel and (1, 1) that of the last. ``vertices`` is (V, 3) float32 in any unit, ``faces`` (F, 3) int32,
    ``normals`` (V, 3) float32 of unit length, ``uv`` (V, 2) float32, ``texture`` (Ht, Wt, 3) uint8 RGB, and
    ``exposure`` (V,) float32 the unoccluded fraction of directions of a vertex, 1 if not baked.

    Raises:
        ValueError: If an array's shape does not fit the others.

    Example:
        >>> import numpy as np
        >>> from kfit.data import Mesh
        >>> corners = np.array([[0, 0, 0], [2, 0, 0], [0, 2, 0]], np.float32)
        >>> up, grey = np.tile(np.float32([0, 0, 1]), (3, 1)), np.full((2, 2, 3), 128, np.uint8)
        >>> mesh = Mesh(corners, np.array([[0, 1, 2]], np.int32), up, np.zeros((3, 2), np.float32), grey)
        >>> mesh.normalised().bounds[1].round(3)
        array([0.354, 0.354, 0.   ], dtype=float32)
    """

    vertices: np.ndarray
    faces: np.ndarray
    normals: np.ndarray
    uv: np.ndarray
    texture: np.ndarray
    exposure: np.ndarray = field(default_factory=lambda: np.zeros(0, np.float32))

    def __post_init__(self) -> None:
        num = len(self.vertices)
        if self.exposure.size == 0:
            object.__setattr__(self, "exposure", np.ones(num, np.float32))
        expected = {"vertices": (num, 3), "normals": (num, 3), "uv": (num, 2), "exposure": (num,)}
        for name, shape in expected.items():
            if getattr(self, name).shape != shape:
                raise ValueError(f"{name} must have shape {shape}, but has {getattr(self, name).shape}.")
        if num == 0 or self.faces.ndim != 2 or self.faces.shape[1] != 3 or len(self.faces) == 0:
            raise ValueError(
                f"faces must be (F, 3) with F > 0 over V > 0 vertices, but {self.faces.shape} over {num} came."
            )
        if self.faces.min() < 0 or self.faces.max() >= num:
            raise ValueError(
                f"faces must index {num} vertices, but runs from {self.faces.min()} to {self.faces.max()}."
            )
        if self.texture.ndim != 3 or self.texture.shape[2] != 3 or self.texture.dtype != np.uint8:
            raise ValueError(f"texture must be (Ht, Wt, 3) uint8, but is {self.texture.shape} {self.texture.dtype}.")

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper corner (3,) of the axis-aligned box of the vertices that faces use."""
        used = self.vertices[np.unique(self.faces)]
        return used.min(axis=0), used.max(axis=0)

    @property
    def extents(self) -> np.ndarray:
        """Sides (3,) of the axis-aligned box, scaled so that its diagonal is 1."""
        low, high = self.bounds
        sides: np.ndarray = (high - low) / max(float(np.linalg.norm(high - low)), 1e-12)
        return sides.astype(np.float32)

    def normalised(self) -> Mesh:
        """Return the mesh with its box centred at the origin and a diagonal of 1, as NOCS does.

        Raises:
            ValueError: If the box has no diagonal or is not finite.
        """
        low, high = self.bounds
        diagonal = float(np.linalg.norm(high - low))
        if not np.isfinite(diagonal) or diagonal <= 0:
            raise ValueError(f"vertices must span a finite box, but its diagonal is {diagonal}.")
        return replace(self, vertices=((self.vertices - (low + high) / 2) / diagonal).astype(np.float32))

    def transformed(self, matrix: np.ndarray) -> Mesh:
        """Apply a (3, 4) or (4, 4) similarity or affine map; normals follow by the inverse transpose."""
        linear, shift = np.asarray(matrix)[:3, :3], np.asarray(matrix)[:3, 3]
        normals = self.normals @ np.linalg.inv(linear)
        normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
        vertices = self.vertices @ linear.T + shift
        return replace(self, vertices=vertices.astype(np.float32), normals=normals.astype(np.float32))


def join(parts: Sequence[Mesh]) -> Mesh:
    """Join several meshes to one, whose texture is an atlas with a tile for each distinct texture.

    Raises:
        ValueError: If no part is given.

    Example:
        >>> import numpy as np
        >>> from kfit.data import build, join
        >>> mug, can = build("mug", seed=0)[0], build("can", seed=0)[0]
        >>> both = join([mug, can])
        >>> len(both.faces) == len(mug.faces) + len(can.faces)
        True
    """
    if not parts:
        raise ValueError("parts must hold at least one mesh, but is empty.")
    tiles = list({id(part.texture): part.texture for part in parts}.values())
    places, (height, width) = _shelves([tile.shape[:2] for tile in tiles])
    atlas = np.zeros((height, width, 3), np.uint8)
    corner = {}
    for tile, (row, column) in zip(tiles, places, strict=True):
        padded = np.pad(tile, ((_MARGIN, _MARGIN), (_MARGIN, _MARGIN), (0, 0)), mode="edge")
        atlas[row : row + padded.shape[0], column : column + padded.shape[1]] = padded
        corner[id(tile)] = (column + _MARGIN, row + _MARGIN)
    uv = []
    for part in parts:
        size = np.array(part.texture.shape[1::-1], np.float32)
        uv.append((np.clip(part.uv, 0, 1) * size + corner[id(part.texture)]) / np.array([width, height], np.float32))
    starts = np.cumsum([0] + [len(part.vertices) for part in parts[:-1]])
    return Mesh(
        vertices=np.concatenate([part.vertices for part in parts]).astype(np.float32),
        faces=np.concatenate([part.faces + s for part, s in zip(parts, starts, strict=True)]).astype(np.int32),
        normals=np.concatenate([part.normals for part in parts]).astype(np.float32),
        uv=np.concatenate(uv).astype(np.float32),
        texture=atlas,
        exposure=np.concatenate([part.exposure for part in parts]).astype(np.float32),
    )


def _shelves(sizes: Sequence[tuple[int, int]]) -> tuple[list[tuple[int, int]], tuple[int, int]]:
    """Return places (row, column) of tiles (height, width) on shelves, the tallest first, and the size of the atlas."""
    padded = [(h + 2 * _MARGIN, w + 2 * _MARGIN) for h, w in sizes]
    limit = max(max(w for _, w in padded), int(np.ceil(np.sqrt(sum(h * w for h, w in padded)))))
    places = [(0, 0)] * len(padded)
    row = column = shelf = 0
    for index in sorted(range(len(padded)), key=lambda i: -padded[i][0]):
        tall, wide = padded[index]
        if column + wide > limit and column > 0:
            row, column, shelf = row + shelf, 0, 0
        places[index] = (row, column)
        column, shelf = column + wide, max(shelf, tall)
    return places, (row + shelf, limit)
