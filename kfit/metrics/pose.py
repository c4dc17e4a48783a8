"""Errors of poses."""

from __future__ import annotations

from torch import Tensor

from kfit.core.check import check_shape
from kfit.geometry import Symmetry, rotation_error


def rotation_error_deg(prediction: Tensor, target: Tensor, symmetry: Symmetry = "none") -> Tensor:
    """Return the angle in degrees between rotations in the same frame, or between their vertical axes (``"y"``).

    Args:
        prediction, target: (…, 3, 3).
        symmetry: symmetry of the object, see `kfit.geometry.CATEGORIES`.

    Returns:
        (…) in [0, 180].

    Example:
        >>> import torch
        >>> from kfit.geometry import rotation_from_angles
        >>> from kfit.metrics import rotation_error_deg
        >>> rotation_error_deg(torch.eye(3), rotation_from_angles(*torch.tensor([0.0, 0.5236, 0.0]))).round()
        tensor(30.)
    """
    return rotation_error(prediction, target, symmetry).rad2deg()


def translation_error_cm(prediction: Tensor, target: Tensor) -> Tensor:
    """Return the distance in centimetres (…) between translations (…, 3) in metres.

    Example:
        >>> import torch
        >>> from kfit.metrics import translation_error_cm
        >>> translation_error_cm(torch.tensor([0.0, 0.0, 1.0]), torch.tensor([0.03, 0.04, 1.0])).round()
        tensor(5.)
    """
    distance: Tensor = (prediction - target).norm(dim=-1)
    return 100 * distance


def scale_agnostic_translation_error(
    prediction: Tensor, target: Tensor, predicted_diagonal: Tensor, diagonal: Tensor
) -> Tensor:
    """Return the error of a translation relative to the objects' sizes, in diagonals: ‖t̂ / d̂ − t / d‖.

    A method that uses colour alone cannot distinguish a small near object from a large far one, but it determines the
    translation over the size (DMSR, ICRA 2024; LaPose, ECCV 2024).

    Args:
        prediction, target: (…, 3).
        predicted_diagonal, diagonal: (…) of the objects' boxes in the same unit.

    Example:
        >>> import torch
        >>> from kfit.metrics import scale_agnostic_translation_error
        >>> near, far = torch.tensor([0.0, 0.0, 0.5]), torch.tensor([0.0, 0.0, 1.0])
        >>> scale_agnostic_translation_error(near, far, torch.tensor(0.1), torch.tensor(0.2))
        tensor(0.)
    """
    error: Tensor = (prediction / predicted_diagonal[..., None] - target / diagonal[..., None]).norm(dim=-1)
    return error


def summary(errors_deg: Tensor) -> dict[str, float]:
    """Return the median of N rotation errors, and the fractions of them under 5°, 10°, 30° and 60°.

    A failed fit (NaN) counts as 180°, the largest error.

    Args:
        errors_deg: (N,).

    Returns:
        ``median`` in degrees, ``under_5``, ``under_10``, ``under_30`` and ``under_60`` in [0, 1].

    Raises:
        ValueError: if there are no errors.

    Example:
        >>> import torch
        >>> from kfit.metrics import summary
        >>> summary(torch.tensor([2.0, 4.0, 20.0, torch.nan]))
        {'median': 12.0, 'under_5': 0.5, 'under_10': 0.5, 'under_30': 0.75, 'under_60': 0.75}
    """
    check_shape("errors_deg", errors_deg, ("N",))
    if not len(errors_deg):
        raise ValueError("errors_deg must hold at least one error, got none")
    errors = errors_deg.double().nan_to_num(nan=180.0)
    shares = {f"under_{limit}": float((errors < limit).double().mean()) for limit in (5, 10, 30, 60)}
    return {"median": float(errors.quantile(0.5)), **shares}
