"""Callbacks, which observe a fit and may remove or freeze rows."""

from kfit.callbacks.progress import Progress
from kfit.callbacks.pruning import Pruning
from kfit.callbacks.stopping import Stopping

__all__ = ["Progress", "Pruning", "Stopping"]
