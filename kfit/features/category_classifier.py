"""A classifier of cropped objects: one of kfit's categories, or none of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from safetensors.torch import load_file
from torch import Tensor, nn

from kfit.features.imagenet_classifier import ImageNetClassifier
from kfit.geometry import CATEGORIES

WEIGHTS = Path(__file__).parent / "category_classifier.safetensors"
SIDE = 224
NONE = "none"
NAMES = (*CATEGORIES, NONE)
# ImageNet's classes (ILSVRC 2012, in their order) that belong to a category or resemble it.
IMAGENET = {
    # beer, water, wine and pop bottle, pill bottle, hair spray, lotion
    "bottle": (440, 898, 907, 737, 720, 585, 631),
    "bowl": (659, 809),  # mixing bowl, soup bowl
    "camera": (732, 759),  # Polaroid, reflex camera
    "can": (653,),  # milk can
    "laptop": (620, 681),  # laptop, notebook
    "mug": (504, 967, 968),  # coffee mug, espresso, cup
}


class CategoryClassifier(nn.Module):
    """Predict the category of the object in a picture: one of six, or none of them.

    p = softmax_k(t · L_k + w_k · f + b_k) with features f (1280) of EfficientNet-Lite0 and
    L_k = log Σ exp of its logits over ImageNet's classes of category k, for "none" over all others. The corrections
    w_k, b_k and t ≥ 0 are trained on procedural objects in front of photos by `kfit.training.category_training`.

    Shape: pictures (N, 3, 224, 224), RGB in [0, 1], an object in its box and a margin; log-probabilities (N, 7) in the
    order of `NAMES`.
    """

    def __init__(self) -> None:
        super().__init__()
        self.network = ImageNetClassifier()
        state = load_file(WEIGHTS)
        self.weight, self.bias, self.trust = state["weight"], state["bias"], state["trust"]

    def forward(self, image: Tensor) -> Tensor:
        features, logits = self.network(image)
        found: Tensor = (self.trust * grouped(logits) + features @ self.weight.T + self.bias).log_softmax(1)
        return found


def object_square(image: NDArray[np.float32], box: NDArray[Any], margin: float) -> Tensor:
    """Cut out the square (3, 224, 224) around an object, for `CategoryClassifier`.

    Args:
        image: (H, W, 3), RGB in [0, 1]; its border pixels are repeated outside.
        box: (4,) left, top, right, bottom in pixels, at least partly inside of the picture.
        margin: on each side, as a fraction of the longer side of the box.
    """
    height, width = image.shape[:2]
    half = max(1.0, (0.5 + margin) * float(max(box[2] - box[0], box[3] - box[1])))
    middle_x, middle_y = (box[0] + box[2]) / 2, (box[1] + box[3]) / 2
    left, top = round(middle_x - half), round(middle_y - half)
    right, bottom = left + max(2, round(2 * half)), top + max(2, round(2 * half))
    inside = image[max(0, top) : max(0, bottom), max(0, left) : max(0, right)]
    beyond = (max(0, -top), max(0, bottom - height), max(0, -left), max(0, right - width))
    whole = cv2.copyMakeBorder(inside, *beyond, cv2.BORDER_REPLICATE)
    how = cv2.INTER_AREA if whole.shape[0] > SIDE else cv2.INTER_LINEAR
    return torch.from_numpy(cv2.resize(whole, (SIDE, SIDE), interpolation=how)).movedim(-1, 0)


def grouped(logits: Tensor) -> Tensor:
    """Return L (N, 7) of ImageNet's logits (N, 1000)."""
    of_category = [logits[:, list(IMAGENET[name])].logsumexp(1) for name in CATEGORIES]
    others = torch.ones(logits.shape[1], dtype=torch.bool)
    for classes in IMAGENET.values():
        others[list(classes)] = False
    return torch.stack([*of_category, logits[:, others].logsumexp(1)], 1)
