"""Networks whose activations energies compare."""

from kfit.features.efficientnet_lite import EfficientNetLite0
from kfit.features.network import FeatureNetwork
from kfit.features.vgg import VGG16, VGG19

__all__ = ["VGG16", "VGG19", "EfficientNetLite0", "FeatureNetwork"]
