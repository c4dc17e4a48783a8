"""A progress bar for a fit."""

from __future__ import annotations

import logging
import sys

from rich.console import Console
from rich.progress import Progress as Bar

from kfit.core import Callback, FitResult, FitState


class Progress(Callback):
    """Shows steps, rows left, the lowest energy and the time left on stderr.

    Silent where stderr is no terminal, and where the logger ``kfit`` takes no warnings.
    """

    def __init__(self) -> None:
        self._bar: Bar | None = None

    def on_start(self, state: FitState) -> None:
        if self._bar is not None:  # of a fit that broke off
            self._bar.stop()
        silent = not sys.stderr.isatty() or not logging.getLogger("kfit").isEnabledFor(logging.WARNING)
        self._bar = Bar(console=Console(stderr=True), transient=True, disable=silent)
        self._task = self._bar.add_task("fitting", total=state.num_steps + 1)
        self._bar.start()

    def on_step(self, state: FitState) -> FitState:
        if self._bar is not None and len(state.energy):
            told = f"fitting · {len(state.energy)} starts · energy {float(state.best_energy.min()):.4g}"
            self._bar.update(self._task, advance=1, description=told)
            if state.step == state.num_steps:
                self._bar.stop()
        return state

    def on_end(self, result: FitResult) -> None:
        if self._bar is not None:
            self._bar.stop()
