"""Showing pages and pictures in the browser of whoever runs a command."""

from __future__ import annotations

import os
import sys
import webbrowser
from collections.abc import Iterable
from pathlib import Path

from kfit.runtime.console import log


def has_screen() -> bool:
    """Return whether a browser's window could be seen here."""
    return sys.platform in ("darwin", "win32") or any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY")))


def open_files(files: Iterable[Path]) -> None:
    """Open files in the browser; where there is none, log where they are."""
    for file in files:
        if not (has_screen() and webbrowser.open(file.absolute().as_uri())):
            log.info("there is no browser to open here; open %s in one", file)
