"""Atomic writing: a reader, or a run after a kill, finds files complete or absent."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory

PARTIAL = ".partial_"
"""What names of things begin with that are being written."""


def atomic_write(folder: Path, files: Mapping[str, Callable[[Path], object]]) -> list[Path]:
    """Have files written aside, and put them in their places once all are complete and on the disk.

    Args:
        folder: where they go; made if it is not there.
        files: by name, or by absolute path for one that goes elsewhere, what writes one to the path that it is given.
            It may find nothing to write.

    Returns:
        Paths of those that were written.

    Raises:
        OSError: If a file cannot be written; the error names it, and all files keep their contents.
    """
    places = [folder / name for name in files]  # absolute paths are kept
    for place in places:
        if place.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(place))
    parents = dict.fromkeys([folder, *(place.parent for place in places)])
    new = [one for parent in parents for one in (parent, *parent.parents) if not one.exists()]
    with ExitStack() as failed:
        # Of what is not written, no folder is left either; one that is not empty stays.
        for one in reversed(new):  # what is called first was pushed last
            failed.callback(_remove, one)
        with ExitStack() as stack:
            asides: dict[Path, Path] = {}
            for place in places:
                if (parent := place.parent) not in asides:
                    with _naming(place):
                        parent.mkdir(parents=True, exist_ok=True)
                        # In the same folder, because a move between file systems is not atomic.
                        asides[parent] = Path(stack.enter_context(TemporaryDirectory(prefix=PARTIAL, dir=parent)))
            written = [asides[place.parent] / place.name for place in places]
            for path, place, write in zip(written, places, files.values(), strict=True):
                with _naming(place):
                    write(path)
            made = [(path, place) for path, place in zip(written, places, strict=True) if path.exists()]
            for path, place in made:
                with _naming(place), path.open("rb") as complete:
                    os.fsync(complete.fileno())
            for path, place in made:
                path.replace(place)
        failed.pop_all()
    return [place for _, place in made]


@contextmanager
def _naming(place: Path) -> Iterator[None]:
    """Have what the system refuses name the place, where it names nothing or what is there only meanwhile."""
    try:
        yield
    except FileExistsError as error:  # the path is not a folder
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), error.filename) from None
    except OSError as error:
        if error.errno is None or (error.filename is not None and PARTIAL not in str(error.filename)):
            raise
        raise OSError(error.errno, os.strerror(error.errno), str(place)) from error


def _remove(folder: Path) -> None:
    with suppress(OSError):
        folder.rmdir()


def check_folder(name: str, folder: Path) -> None:
    """Refuse a folder that nothing can be written to, before work is done whose result would go there; makes nothing.

    Args:
        name: name of the argument.
        folder: need not be there.

    Raises:
        OSError: if it, or an existing part of its path, is not a folder or not writable.
    """
    there = folder.absolute()
    try:
        os.lstat(there)
    except (FileNotFoundError, NotADirectoryError):
        there = next(parent for parent in there.parents if os.path.lexists(parent))
    except OSError as error:
        raise OSError(f"{name}: {error.strerror}: {folder}") from None
    if not there.is_dir():
        raise OSError(f"{name} must name a folder, but {there} is not one")
    if not os.access(there, os.W_OK | os.X_OK):
        code = errno.EROFS if os.statvfs(there).f_flag & os.ST_RDONLY else errno.EACCES
        raise OSError(f"{os.strerror(code)}: {name} {there}")
