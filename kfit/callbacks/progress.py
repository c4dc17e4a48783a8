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
    """Show steps, rows left, the lowest energy and the time left on stderr.

    It shows nothing if stderr is not a terminal, or if the logger ``kfit`` does not emit warnings.

    Example:
        >>> import torch, kfit
        >>> from kfit.callbacks import Progress
        >>> from kfit.energies import L2
        >>> from kfit.generators import Template
        >>> from kfit.initializers import Uniform
        >>> from kfit.optimizers import Adam
        >>> fit = kfit.FitPipeline(
        ...     Template(torch.rand(1, 16, 16), "translation"),
        ...     energies={"l2": L2()},
        ...     initializers=[Uniform("shift", -0.2, 0.2)],
        ...     optimizer=Adam(0.02),
        ...     callbacks=[Progress()],
        ...     num_starts=8,
        ...     num_steps=20,
        ... )
        >>> result = fit(kfit.Observation(torch.rand(1, 1, 16, 16)))  # a bar, in a terminal
    """

    def __init__(self) -> None:
        self._bar: Bar | None = None
        self._stop: Callable[[], object] = _nothing

    def on_start(self, state: FitState) -> None:
        self._stop()  # the bar of an earlier fit that failed
        silent = not sys.stderr.isatty() or not logging.getLogger("kfit").isEnabledFor(logging.WARNING)
        bar = Bar(console=Console(stderr=True), transient=True, disable=silent)
        self._task = bar.add_task("fitting", total=state.num_steps + 1)
        bar.start()
        self._bar = bar  # assigned when complete, because a fit in another thread may use it
        # Also when this object is deleted: a bar that is not stopped leaves the terminal's cursor hidden.
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
    """Do nothing, in place of stopping a bar that does not exist yet."""
