"""Suppress warnings of a library while it reads, also in several threads at once."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock

_LOCK = Lock()
_inside = 0
_filters: warnings.catch_warnings[None] = warnings.catch_warnings()


@contextmanager
def ignore_warnings() -> Iterator[None]:
    """Ignore warnings in a ``with`` statement; after the last of those that overlap, filters are as before the first.

    `warnings.catch_warnings` alone leaves them changed for good where threads overlap: the filters are the process's,
    and whoever ends last puts back what the other had set.
    """
    global _inside, _filters
    with _LOCK:
        if _inside == 0:
            _filters = warnings.catch_warnings()
            _filters.__enter__()
            warnings.simplefilter("ignore")
        _inside += 1
    try:
        yield
    finally:
        with _LOCK:
            _inside -= 1
            if _inside == 0:
                _filters.__exit__(None, None, None)
