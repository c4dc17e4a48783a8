"""Registration of pictures in one call."""

from kfit.registration.register import register
from kfit.registration.result import Registration

__all__ = ["Registration", "register"]
