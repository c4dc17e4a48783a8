"""The local page: a picture in, a box around the object, the fit as it converges, the answer out."""

from kfit.app.session import Session, Sessions
from kfit.app.uploads import LARGEST_FILE, LARGEST_PICTURE, read_upload
from kfit.app.watched import Drawn, watched

__all__ = ["LARGEST_FILE", "LARGEST_PICTURE", "Drawn", "Session", "Sessions", "read_upload", "watched"]
