"""The place of an error in a user's own file, of which kfit is not the cause."""

from __future__ import annotations

import re
import sys
import sysconfig
import traceback
from pathlib import Path


def own_part(error: Exception) -> str | None:
    """Return the innermost line of a file that is neither kfit's nor installed, where an error passed through one.

    A function of such a file that was called with other arguments than it takes is named too.
    """
    frames = traceback.extract_tb(error.__traceback__)
    if own := [frame for frame in frames if _is_own(frame.filename)]:
        return f"{own[-1].filename}, line {own[-1].lineno}"
    called = re.match(r"((?:\w+\.)*\w+)\(\) (?:takes|got|missing) ", str(error))
    for module in list(sys.modules.values()) if called and isinstance(error, TypeError) else ():
        file = getattr(module, "__file__", None)
        if called and file and _is_own(file) and called[1].partition(".")[0] in vars(module):
            return f"{file}, {called[1]}"
    return None


def _is_own(file: str) -> bool:
    paths = sysconfig.get_paths()
    installed = [str(Path(__file__).parents[1]), *(paths[name] for name in ("stdlib", "purelib", "platlib"))]
    return not file.startswith(("<", *installed)) and "site-packages" not in file
