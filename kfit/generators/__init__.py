"""What draws, and the networks beside it."""

from kfit.generators.encoder import ConvEncoder
from kfit.generators.extents import ExtentsHead
from kfit.generators.similarity_warp import SimilarityWarp
from kfit.generators.vae3d import VAE3D

__all__ = ["VAE3D", "ConvEncoder", "ExtentsHead", "SimilarityWarp"]
