"""The visits of all who have the page open."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping
from pathlib import Path
from tempfile import mkdtemp
from threading import Lock, Timer

from kfit.app.session import Session

# Idle visitors are forgotten beyond so many sessions, and pixels in all of them, which are 12 bytes each.
MOST_SESSIONS, MOST_PIXELS = 24, 200_000_000
# Seconds for which a visit is kept after its page was closed, as a reload closes it too.
GRACE = 60.0


class Sessions:
    """All visitors' sessions; of those that are not busy, the one used longest ago makes room where they are too many.

    Args:
        folder: in which each gets a folder of its own.
        models: paths of models by their category, each instead of a bundled one.
    """

    def __init__(self, folder: Path, models: Mapping[str, str] | None = None) -> None:
        self.folder, self.models = folder, models or {}
        self._open: OrderedDict[str, Session] = OrderedDict()
        self._leaving: dict[str, Timer] = {}
        self._lock = Lock()

    def __len__(self) -> int:
        return len(self._open)

    def of(self, visitor: str) -> Session:
        """The visitor's session, a new one at the first call."""
        with self._lock:
            if (timer := self._leaving.pop(visitor, None)) is not None:
                timer.cancel()
            if visitor not in self._open:
                self._open[visitor] = Session(Path(mkdtemp(prefix="session-", dir=self.folder)), self.models)
            self._open.move_to_end(visitor)
            idle = [name for name, session in self._open.items() if not session.busy and name != visitor]
            for name in idle:
                pixels = sum(session.pixels for session in self._open.values())
                if len(self._open) <= MOST_SESSIONS and pixels <= MOST_PIXELS:
                    break
                self._open.pop(name).close()
            return self._open[visitor]

    def leave(self, visitor: str) -> None:
        """Forget the visitor after `GRACE`, unless they come back."""
        timer = Timer(GRACE, self.close, [visitor])
        timer.daemon = True
        with self._lock:
            if (before := self._leaving.pop(visitor, None)) is not None:
                before.cancel()
            self._leaving[visitor] = timer
        timer.start()

    def close(self, visitor: str) -> None:
        """Forget the visitor and delete what is theirs; fine where nothing is."""
        with self._lock:
            self._leaving.pop(visitor, None)
            session = self._open.pop(visitor, None)
        if session is not None:
            session.close()
