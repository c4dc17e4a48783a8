"""The app's four examples: a photo that scikit-image ships, and three objects rendered on a table."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

HERE = Path(__file__).parent


@dataclass(frozen=True)
class Example:
    """A picture with one object, and a mask that shows it.

    Attributes:
        name: common name of its files.
        category: category of the object.
        title: title that users see.
    """

    name: str
    category: str
    title: str

    def image(self) -> NDArray[np.uint8]:
        """The picture (H, W, 3)."""
        if self.name == "coffee":
            from skimage.data import coffee

            shipped: NDArray[np.uint8] = coffee()
            return shipped
        from skimage.io import imread

        drawn: NDArray[np.uint8] = imread(HERE / f"{self.name}.jpg")
        return drawn

    @property
    def mask(self) -> Path:
        """File of the mask, white on the object."""
        return HERE / f"{self.name}_mask.png"

    def save_photo(self, path: Path) -> None:
        """Write the picture as a PNG file."""
        from PIL import Image

        Image.fromarray(self.image()).save(path, "PNG")

    def save_mask(self, path: Path) -> None:
        """Write the mask as a PNG file."""
        path.write_bytes(self.mask.read_bytes())


EXAMPLES = [
    Example("coffee", "mug", "A cup of coffee, photo"),
    Example("laptop", "laptop", "A laptop, rendered"),
    Example("camera", "camera", "A camera, rendered"),
    Example("bottle", "bottle", "A bottle, rendered"),
]
