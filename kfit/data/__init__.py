"""Data: procedural objects, meshes, a rasterizer, views in HDF5 and the LightningDataModule that serves them."""

from kfit.data.datamodule import ViewPairs, ViewsDataModule
from kfit.data.mesh import Mesh, join
from kfit.data.rasterizer import Light, View, pose_view, render
from kfit.data.shapes import CATEGORIES, build
from kfit.data.views import Views, build_views

__all__ = [
    "CATEGORIES",
    "Light",
    "Mesh",
    "View",
    "ViewPairs",
    "Views",
    "ViewsDataModule",
    "build",
    "build_views",
    "join",
    "pose_view",
    "render",
]
