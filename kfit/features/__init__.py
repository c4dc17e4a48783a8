"""Networks whose activations energies compare."""

from kfit.features.activations import Activations
from kfit.features.alexnet import AlexNet
from kfit.features.efficientnet_lite import EfficientNetLite0
from kfit.features.network import FeatureNetwork
from kfit.features.pose_refiner import PoseRefiner
from kfit.features.vgg import VGG16, VGG19

__all__ = ["VGG16", "VGG19", "Activations", "AlexNet", "EfficientNetLite0", "FeatureNetwork", "PoseRefiner"]
