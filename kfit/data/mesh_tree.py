"""The files of a mesh: materials and textures in its own folders only."""

from __future__ import annotations

import hashlib
import io
import re
from collections.abc import Iterator, Sequence
from functools import lru_cache
from pathlib import Path
from typing import NoReturn

from PIL import Image
from trimesh.resolvers import Resolver

LARGEST_COMPANION = 512 * 1024**2
MOST_MATERIALS = 2_000
_LIBRARY, _BUFFER = ".mtl", ".bin"
_PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".tga", ".gif", ".tif", ".tiff", ".webp")
_ENTRY = re.compile(rb"^\s*(?:newmtl|map_kd)\s", re.IGNORECASE | re.MULTILINE)


class MeshTree(Resolver):
    """Reads files named by a mesh file, within the folders of the mesh.

    That is the folder of the mesh with all below it and, as in ShapeNetCore.v2, for ``models/model_normalized.obj``
    the folder ``images`` next to ``models``. Only regular files are opened, so that no pipe is waited for.

    Args:
        path: path of the mesh.

    Attributes:
        dropped: files that could not be read, with reasons.
        too_large: a sentence where a material library is too large to be read.
    """

    def __init__(self, path: Path) -> None:
        self.file_name, self.roots = path.name, roots(path)
        self.dropped: list[str] = []
        self.too_large: str | None = None

    def get(self, name: str) -> bytes:
        """Bytes of a file.

        Raises:
            FileNotFoundError: if it is no regular file of the tree, or too large.
        """
        plain = name.strip().replace("\\", "/")
        candidates = (plain, plain.lstrip("/"), plain.rsplit("/", 1)[-1])
        path = next((path for path in map(self._inside, candidates) if path is not None), None)
        if path is None:
            self._drop(name, "no file of that name in the mesh's own folders")
        if path.stat().st_size > LARGEST_COMPANION:
            self._drop(name, f"more than {LARGEST_COMPANION >> 20} MB")
        content = path.read_bytes()
        if path.suffix.lower() == _LIBRARY:
            if (count := len(_ENTRY.findall(content))) > 2 * MOST_MATERIALS:
                self.too_large = f"{name} has {count:,} materials and textures, more than {2 * MOST_MATERIALS:,}"
                self._drop(name, "too many materials")
        elif path.suffix.lower() in _PICTURES:
            try:
                Image.open(io.BytesIO(content)).close()
            except Exception as error:  # Pillow raises whatever its many readers raise
                self._drop(name, f"no picture that can be read: {type(error).__name__}")
        return content

    def _inside(self, name: str) -> Path | None:
        try:
            path = (self.roots[0] / name).resolve()
            inside = any(path.is_relative_to(root) for root in self.roots)
            return path if inside and path.is_file() else None
        except (OSError, ValueError, RuntimeError):  # names that are too long, hold NUL, or link to themselves
            return None

    def _drop(self, name: str, reason: str) -> NoReturn:
        self.dropped.append(f"{name[:200]!r} ({reason})")
        raise FileNotFoundError(name)

    def keys(self) -> Iterator[str]:
        """Nothing: files are asked for by name."""
        return iter(())

    def namespaced(self, namespace: str) -> NoReturn:
        """Refuse: names are those in the mesh's own folder."""
        raise io.UnsupportedOperation("a mesh's folder has no names below it")

    def write(self, name: str, data: object) -> NoReturn:
        """Refuse: the mesh's folder is only read."""
        raise io.UnsupportedOperation("a mesh's folder is only read")


def roots(path: Path) -> list[Path]:
    """Return the folders of a mesh, its own first."""
    folder = path.absolute().parent.resolve()
    images = folder.parent / "images"
    return [folder, images] if folder.name == "models" and images.is_dir() and not images.is_symlink() else [folder]


def mesh_identities(files: Sequence[Path]) -> list[str]:
    """Identify meshes by name and content, including materials and textures in their folders.

    Returns:
        The name and 16 hexadecimal digits of each.
    """
    companions = {folder: _companions(folder) for folder in {root for file in files for root in roots(file)}}
    found = []
    for file in files:
        own = [_digest_of(file), *(one for root in roots(file) for one in companions[root])]
        digest = hashlib.sha256("\n".join(own).encode()).hexdigest()
        found.append(f"{file.name} {digest[:16]}")
    return found


def _companions(folder: Path) -> list[str]:
    kinds = (_LIBRARY, _BUFFER, *_PICTURES)
    files = sorted(path for path in folder.rglob("*") if path.suffix.lower() in kinds and path.is_file())
    return [f"{path.relative_to(folder)} {_digest_of(path)}" for path in files]


def _digest_of(path: Path) -> str:
    status = path.stat()
    return _digest(str(path), status.st_size, status.st_mtime_ns)


@lru_cache(maxsize=100_000)
def _digest(path: str, size: int, changed: int) -> str:
    """Hash a file's content; size and modification time show whether it must be read again."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
