"""Plausibility of intrinsics for a photo."""

from __future__ import annotations

import math

from torch import Tensor

# Focal lengths over the photo's longer side: the least is a field of view of 157°, more than that of any rectilinear
# lens (the widest have some 130°), the largest is that of a telescope (0.06°).
LEAST_FOCAL, MOST_FOCAL = 0.1, 1000.0
# Ratio of the focal lengths: anamorphic video reaches 2; a fit, which scales both alike, tolerates 1.05.
MOST_ASPECT, SQUARE = 2.0, 1.05
# Even a crop from a photo's corner lies within this angle of the optical axis.
MOST_OFF_AXIS_DEG = 75.0
# Fractions of the photo's sides: largest distance of a principal point from the middle without cropping, and tolerance
# of equality.
OFF_CENTRE, ALIKE = 0.15, 0.03


def check_intrinsics(intrinsics: Tensor, width: int, height: int, notes: list[str], warnings: list[str]) -> None:
    """Refuse intrinsics that cannot belong to a photo, and report those that seem to belong to another photo.

    Args:
        intrinsics: (3, 3), finite, with positive focal lengths.
        width, height: of the photo in pixels.
        notes: gets a sentence if pixels are not square, or the principal point is far from the middle, as in cropped
            photos.
        warnings: gets a sentence if the principal point is the middle of a picture of another size.

    Raises:
        ValueError: if a focal length is outside [0.1, 1000] longer sides, one is more than twice the other, or the
            photo's middle is more than 75° off the optical axis.
    """
    fx, fy, x, y = (float(intrinsics[place]) for place in ((0, 0), (1, 1), (0, 2), (1, 2)))
    least, most = LEAST_FOCAL * max(width, height), MOST_FOCAL * max(width, height)
    if not (least <= fx <= most and least <= fy <= most):
        raise ValueError(
            f"intrinsics of a photo of {width} x {height} must have focal lengths from {least:g} to {most:g} "
            f"pixels, got {fx:g} and {fy:g}"
        )
    aspect = max(fx / fy, fy / fx)
    if aspect > MOST_ASPECT:
        raise ValueError(f"intrinsics must have focal lengths of which none is twice the other, got {fx:g} and {fy:g}")
    right, down = x - (width - 1) / 2, y - (height - 1) / 2
    off_axis = math.degrees(math.atan(math.hypot(right / fx, down / fy)))
    if off_axis > MOST_OFF_AXIS_DEG:
        raise ValueError(
            f"intrinsics of a photo of {width} x {height} must have their principal point near it, got ({x:g}, {y:g}), "
            f"by which the photo's middle is {off_axis:.0f}° off the optical axis"
        )
    if aspect > SQUARE:
        notes.append(
            f"the focal lengths differ ({fx:g} and {fy:g} pixels): a fit takes pixels for square, and shape and pose "
            "are off where they are not"
        )
    # The middle of a picture k × as large is k × as far from the corner of its first pixel.
    across, along = (2 * x + 1) / width, (2 * y + 1) / height
    times = (across + along) / 2
    if max(abs(right) / width, abs(down) / height) <= OFF_CENTRE:
        return
    if times > 0 and abs(across - along) <= ALIKE * times:
        warnings.append(
            f"the principal point ({x:g}, {y:g}) is the middle of a picture of {times * width:.0f} x "
            f"{times * height:.0f} pixels, the photo has {width} x {height}: intrinsics of a picture of another size "
            "must be scaled to this one's; the confidence is 50 % at most"
        )
    else:
        notes.append(
            f"the principal point ({x:g}, {y:g}) is far from the photo's middle: are these the intrinsics of another "
            "picture? They are right for a photo that was cropped"
        )
