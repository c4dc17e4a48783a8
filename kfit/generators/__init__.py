"""Generators, and the networks that belong to them: encoders and heads."""

from kfit.generators.encoder import ConvEncoder
from kfit.generators.extents import ExtentsHead
from kfit.generators.feature_encoder import FeatureEncoder
from kfit.generators.mesh import MeshRenderer
from kfit.generators.mesh_in_camera import MeshInCamera
from kfit.generators.metric_depth import MetricDepth
from kfit.generators.multi_view import MultiView
from kfit.generators.onnx_generator import OnnxGenerator
from kfit.generators.pose_head import PoseHead
from kfit.generators.radiance_field import RadianceField
from kfit.generators.rotation_head import RotationHead
from kfit.generators.similarity_warp import SimilarityWarp, fixed_camera
from kfit.generators.template import Template
from kfit.generators.vae2d import VAE2D
from kfit.generators.vae3d import VAE3D
from kfit.generators.volume_template import VolumeTemplate

__all__ = [
    "VAE2D",
    "VAE3D",
    "ConvEncoder",
    "ExtentsHead",
    "FeatureEncoder",
    "MeshInCamera",
    "MeshRenderer",
    "MetricDepth",
    "MultiView",
    "OnnxGenerator",
    "PoseHead",
    "RadianceField",
    "RotationHead",
    "SimilarityWarp",
    "Template",
    "VolumeTemplate",
    "fixed_camera",
]
