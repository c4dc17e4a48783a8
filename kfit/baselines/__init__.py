"""Baselines: a regressor of rotations, and one of object coordinates with its pose estimation."""

from kfit.baselines.coordinate_pose import pose_of_coordinates
from kfit.baselines.coordinate_regressor import CoordinateRegressor
from kfit.baselines.orientation_regressor import OrientationRegressor

__all__ = ["CoordinateRegressor", "OrientationRegressor", "pose_of_coordinates"]
