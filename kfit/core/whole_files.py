"""Writing files so that a reader, or a run after a kill, finds them whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from contextlib import ExitStack, suppress
from pathlib import Path
from tempfile import TemporaryDirectory

PARTIAL = ".partial_"
"""What names of things begin with that are being written."""


def write_whole(folder: Path, files: Mapping[str, Callable[[Path], object]]) -> list[Path]:
    """Have files written aside, and put them in their places once all are complete and on the disk.

    Args:
        folder: where they go; made if it is not there.
        files: by name, or by absolute path for one that goes elsewhere, what writes one to the path that it is given.
            It may find nothing to write.

    Returns:
        Paths of those that were written.
    """
    places = [folder / name for name in files]  # an absolute path stays what it is
    parents = dict.fromkeys([folder, *(place.parent for place in places)])
    new = [one for parent in parents for one in (parent, *parent.parents) if not one.exists()]
    with ExitStack() as failed:
        # Of what is not written, no folder is left either; one that is not empty stays.
        for one in reversed(new):  # what is called first was pushed last
            failed.callback(_remove, one)
        with ExitStack() as stack:
            asides: dict[Path, Path] = {}
            for parent in parents:
                parent.mkdir(parents=True, exist_ok=True)
                # In the same folder, as nothing is moved whole from one file system to another.
                asides[parent] = Path(stack.enter_context(TemporaryDirectory(prefix=PARTIAL, dir=parent)))
            written = [asides[place.parent] / place.name for place in places]
            for path, write in zip(written, files.values(), strict=True):
                write(path)
            made = [(path, place) for path, place in zip(written, places, strict=True) if path.exists()]
            for path, _ in made:
                with path.open("rb") as complete:
                    os.fsync(complete.fileno())
            for path, place in made:
                path.replace(place)
        failed.pop_all()
    return [place for _, place in made]


def _remove(folder: Path) -> None:
    with suppress(OSError):
        folder.rmdir()


def check_folder(name: str, folder: Path) -> None:
    """Refuse a folder that nothing can be written to, before work is done whose result would go there; makes nothing.

    Args:
        name: of the argument.
        folder: need not be there.

    Raises:
        OSError: if it, or what of the path to it exists, is no folder, or may not be written to.
    """
    there = folder.absolute()
    try:
        os.lstat(there)
    except (FileNotFoundError, NotADirectoryError):
        there = next(parent for parent in there.parents if os.path.lexists(parent))
    except OSError as error:
        raise OSError(f"{name}: {error.strerror}: {folder}") from None
    if not there.is_dir():
        raise OSError(f"{name} must name a folder, but {there} is none")
    if not os.access(there, os.W_OK | os.X_OK):
        raise OSError(f"{name}: {there} may not be written to")
