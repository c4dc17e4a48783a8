"""Selectors: which start wins."""

from kfit.selectors.clusters import Clusters
from kfit.selectors.lowest_energy import LowestEnergy
from kfit.selectors.rotation_vote import RotationVote

__all__ = ["Clusters", "LowestEnergy", "RotationVote"]
