"""How rows move downhill."""

from kfit.optimizers.adam import Adam

__all__ = ["Adam"]
