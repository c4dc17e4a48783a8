"""Data: procedural objects, meshes, a rasterizer, views in HDF5 and the LightningDataModule that serves them."""

from kfit.data.categories_datamodule import CategoriesDataModule
from kfit.data.category_files import read_category
from kfit.data.datamodule import ViewsDataModule
from kfit.data.light import Light
from kfit.data.mesh import Mesh, join
from kfit.data.nocs_alignment import align
from kfit.data.nocs_frame import NOCSFrame, NOCSObject, read_frame
from kfit.data.nocs_frames import NOCSFrames
from kfit.data.nocs_pickle import dump_pickle, load_pickle
from kfit.data.nocs_results import NOCSPrediction, make_result, read_results, result_files, write_result
from kfit.data.rasterizer import View, pose_view, render
from kfit.data.rendered_views import build_views
from kfit.data.shapes import CATEGORIES, build
from kfit.data.view_pairs import ViewPairs
from kfit.data.views import Views

__all__ = [
    "CATEGORIES",
    "CategoriesDataModule",
    "Light",
    "Mesh",
    "NOCSFrame",
    "NOCSFrames",
    "NOCSObject",
    "NOCSPrediction",
    "View",
    "ViewPairs",
    "Views",
    "ViewsDataModule",
    "align",
    "build",
    "build_views",
    "dump_pickle",
    "join",
    "load_pickle",
    "make_result",
    "pose_view",
    "read_category",
    "read_frame",
    "read_results",
    "render",
    "result_files",
    "write_result",
]
