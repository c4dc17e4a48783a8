"""What looks on during a fit."""

from kfit.callbacks.progress import Progress
from kfit.callbacks.pruning import Pruning

__all__ = ["Progress", "Pruning"]
