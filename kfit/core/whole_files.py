"""Writing files so that a reader, or a run after a kill, finds them whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

PARTIAL = ".partial_"
"""What names of things begin with that are being written."""


def write_whole(folder: Path, files: Mapping[str, Callable[[Path], object]]) -> list[Path]:
    """Have files written aside, and put them in their places once all are complete and on the disk.

    Args:
        folder: where they go; made if it is not there.
        files: by name, what writes one to the path that it is given. It may find nothing to write.

    Returns:
        Paths of those that were written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(prefix=PARTIAL, dir=folder) as aside:
        for name, write in files.items():
            write(Path(aside) / name)
        made = [name for name in files if (Path(aside) / name).exists()]
        for name in made:
            with (Path(aside) / name).open("rb") as written:
                os.fsync(written.fileno())
        for name in made:
            (Path(aside) / name).replace(folder / name)
    return [folder / name for name in made]
