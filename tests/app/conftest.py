"""A drawn mug on white, and the same with an alpha channel."""

from pathlib import Path

import numpy as np
import pytest
from skimage.io import imsave

from kfit.data import build, pose_view


@pytest.fixture(scope="session")
def drawn_mug():
    """RGB and mask, (128, 128, 4) bytes."""
    mesh, light = build("mug", 11)
    view = pose_view(mesh, 0.5, 0.6, light, 128)
    return (255 * np.concatenate([view.image, view.mask[..., None]], 2)).round().astype(np.uint8)


@pytest.fixture
def upload(tmp_path):
    """Writes pixels as a file that a browser has just handed in."""

    def write(pixels, name="mug.png") -> Path:
        path = tmp_path / "uploads" / name
        path.parent.mkdir(exist_ok=True)
        imsave(path, pixels, check_contrast=False)
        return path

    return write
