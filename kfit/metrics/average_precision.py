"""Average precision of ranked predictions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kfit.core.arguments import check_arguments


def average_precision(matched: NDArray[np.bool_], num_truths: int) -> NDArray[np.float64]:
    """Return the area under the precision–recall curve with monotone precision (VOC 2010 and later, all points).

    With P_k the precision and R_k the recall among the k best predictions, AP = Σ_k (R_k − R_{k−1}) · max_{l ≥ k} P_l.
    Without a truth it equals NOCS's compute_ap_from_matches_scores (utils.py of hughw19/NOCS_CVPR2019@f882eb88): 0
    without predictions, else NaN.

    Args:
        matched: (…, P) whether each prediction matches a truth, by decreasing score.
        num_truths: number of truths, found or not.

    Returns:
        (…) in [0, 1].

    Example:
        >>> import numpy as np
        >>> from kfit.metrics import average_precision
        >>> average_precision(np.array([True, False, True]), num_truths=2).round(3)
        np.float64(0.833)
    """
    check_arguments(average_precision, locals(), num_truths=(0,))
    found = matched.cumsum(-1)
    precision = found / np.arange(1, matched.shape[-1] + 1)
    envelope = np.maximum.accumulate(precision[..., ::-1], -1)[..., ::-1]
    with np.errstate(all="ignore"):
        # Single precision as published, for equality in all digits.
        recall = (found.astype(np.float32) / np.float32(num_truths)).astype(np.float64)
    area: NDArray[np.float64] = (np.diff(recall, axis=-1, prepend=0) * envelope).sum(-1)
    return area
