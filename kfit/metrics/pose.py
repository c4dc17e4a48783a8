"""How far a pose is from the truth."""

from __future__ import annotations

from torch import Tensor

from kfit.core.check import check_shape
from kfit.geometry import Symmetry, rotation_error


def rotation_error_deg(prediction: Tensor, target: Tensor, symmetry: Symmetry = "none") -> Tensor:
    """Angle in degrees between rotations (…, 3, 3) in the same frame, or between their vertical axes (``"y"``).

    Args:
        symmetry: of the object; a category's stands in `kfit.geometry.CATEGORIES`.

    Returns:
        (…) in [0, 180].
    """
    return rotation_error(prediction, target, symmetry).rad2deg()


def translation_error_cm(prediction: Tensor, target: Tensor) -> Tensor:
    """Distance in centimetres (…) between translations (…, 3) in metres."""
    distance: Tensor = (prediction - target).norm(dim=-1)
    return 100 * distance


def scale_agnostic_translation_error(
    prediction: Tensor, target: Tensor, predicted_diagonal: Tensor, diagonal: Tensor
) -> Tensor:
    """Error of a translation once both objects have the same size, in diagonals: ‖t̂ / d̂ − t / d‖.

    A method that sees colour alone cannot tell a small near object from a large far one; what it can tell is the
    translation over the size (DMSR, ICRA 2024; LaPose, ECCV 2024).

    Args:
        prediction, target: (…, 3).
        predicted_diagonal, diagonal: (…) of the objects' boxes in the same unit.
    """
    error: Tensor = (prediction / predicted_diagonal[..., None] - target / diagonal[..., None]).norm(dim=-1)
    return error


def summary(errors_deg: Tensor) -> dict[str, float]:
    """Median of N rotation errors, and the shares of them under 5°, 10°, 30° and 60°.

    A fit that failed (NaN) counts as 180°, the worst there is.

    Args:
        errors_deg: (N,).

    Returns:
        ``median`` in degrees, ``under_5``, ``under_10``, ``under_30`` and ``under_60`` in [0, 1].

    Raises:
        ValueError: if there are none.
    """
    check_shape("errors_deg", errors_deg, ("N",))
    if not len(errors_deg):
        raise ValueError("errors_deg must hold at least one error, got none")
    errors = errors_deg.double().nan_to_num(nan=180.0)
    shares = {f"under_{limit}": float((errors < limit).double().mean()) for limit in (5, 10, 30, 60)}
    return {"median": float(errors.quantile(0.5)), **shares}
