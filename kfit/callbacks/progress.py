"""A progress bar for a fit."""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable
from weakref import finalize

from rich.console import Console
from rich.progress import Progress as Bar

from kfit.core import Callback, FitResult, FitState


class Progress(Callback):
    """Shows steps, rows left, the lowest energy and the time left on stderr.

    Silent where stderr is no terminal, and where the logger ``kfit`` takes no warnings.
    """

    def __init__(self) -> None:
        self._bar: Bar | None = None
        self._stop: Callable[[], object] = _nothing

    def on_start(self, state: FitState) -> None:
        self._stop()  # the bar of a fit that broke off
        silent = not sys.stderr.isatty() or not logging.getLogger("kfit").isEnabledFor(logging.WARNING)
        bar = Bar(console=Console(stderr=True), transient=True, disable=silent)
        self._task = bar.add_task("fitting", total=state.num_steps + 1)
        bar.start()
        self._bar = bar  # whole, as another thread's fit may show its steps in it
        # Also where nobody fits any more: a bar that is left hides the terminal's cursor for good.
        self._stop = finalize(self, bar.stop)

    def on_step(self, state: FitState) -> FitState:
        if self._bar is not None and len(state.energy):
            text = f"fitting · {len(state.energy)} starts · energy {float(state.best_energy.min()):.4g}"
            self._bar.update(self._task, advance=1, description=text)
            if state.step == state.num_steps:
                self._stop()
        return state

    def on_end(self, result: FitResult) -> None:
        self._stop()


def _nothing() -> None:
    """Of a bar that is not there yet."""
