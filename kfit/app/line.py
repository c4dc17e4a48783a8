"""The line in which visitors wait for their fits, which run one after another."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from threading import Condition

# In the line, the one whose fit runs among them; a fit takes some seconds.
MOST = 20
# Seconds until a visitor who waits is shown the place anew.
PATIENCE = 1.0


class Line:
    """First come, first served."""

    def __init__(self) -> None:
        self._tickets: list[object] = []
        self._moved = Condition()

    @contextmanager
    def joined(self) -> Iterator[Iterator[int]]:
        """Stand in the line in a ``with`` statement; iterate to wait: each item is how many are still before.

        Raises:
            ValueError: if the line is full.
        """
        ticket = object()
        with self._moved:
            if len(self._tickets) >= MOST:
                raise ValueError(f"{MOST} people are waiting for their fits already. Try again in a minute.")
            self._tickets.append(ticket)
        try:
            yield self._before(ticket)
        finally:
            with self._moved:
                self._tickets.remove(ticket)
                self._moved.notify_all()

    def _before(self, ticket: object) -> Iterator[int]:
        while True:
            with self._moved:
                before = self._tickets.index(ticket)
            if before == 0:
                return
            yield before
            with self._moved:
                if self._tickets.index(ticket) == before:
                    self._moved.wait(PATIENCE)
