"""What looks on during a fit."""

from kfit.callbacks.progress import Progress
from kfit.callbacks.pruning import Pruning
from kfit.callbacks.stopping import Stopping

__all__ = ["Progress", "Pruning", "Stopping"]
