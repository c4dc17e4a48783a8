"""From a photo to an answer: inputs, the observed object, a category's model, its fit and its interpretation."""

from kfit.pose.card import Card
from kfit.pose.category_model import CategoryModel
from kfit.pose.result import Alternative, PoseResult

__all__ = ["Alternative", "Card", "CategoryModel", "PoseResult"]
