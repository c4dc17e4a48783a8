"""Pure functions on tensors: pose conventions, crops, cameras, boxes, and constants of categories."""

from kfit.geometry.boxes import EDGES, box_corners, project
from kfit.geometry.camera import (
    UNIT_FRACTION,
    diagonal_at,
    distance_by_focal,
    focal_by_distance,
    intrinsics_from_fov,
    pose_from_crop,
    viewing_ray,
    viewing_ray_rotation,
    with_focal,
)
from kfit.geometry.categories import CATEGORIES, Category
from kfit.geometry.clusters import energy_weights, rotation_clusters, rotation_sigma_deg
from kfit.geometry.crop import Crop
from kfit.geometry.exif import intrinsics_from_exif, was_cropped
from kfit.geometry.observed_crop import depth_along, observed
from kfit.geometry.pose import (
    angles_from_rotation,
    azimuth_from_released,
    from_opencv,
    rotation_error,
    rotation_from_angles,
    to_opencv,
)
from kfit.geometry.pose_network import PoseNetwork
from kfit.geometry.refiner_network import (
    PoseUpdate,
    RefinerNetwork,
    refiner_input,
    rotation_update,
    updated_rotation,
)
from kfit.geometry.symmetry import SYMMETRIES, Symmetry, check_symmetry, num_turns, turns_about_y

__all__ = [
    "CATEGORIES",
    "EDGES",
    "SYMMETRIES",
    "UNIT_FRACTION",
    "Category",
    "Crop",
    "PoseNetwork",
    "PoseUpdate",
    "RefinerNetwork",
    "Symmetry",
    "angles_from_rotation",
    "azimuth_from_released",
    "box_corners",
    "check_symmetry",
    "depth_along",
    "diagonal_at",
    "distance_by_focal",
    "energy_weights",
    "focal_by_distance",
    "from_opencv",
    "intrinsics_from_exif",
    "intrinsics_from_fov",
    "num_turns",
    "observed",
    "pose_from_crop",
    "project",
    "refiner_input",
    "rotation_clusters",
    "rotation_error",
    "rotation_from_angles",
    "rotation_sigma_deg",
    "rotation_update",
    "to_opencv",
    "turns_about_y",
    "updated_rotation",
    "viewing_ray",
    "viewing_ray_rotation",
    "was_cropped",
    "with_focal",
]
