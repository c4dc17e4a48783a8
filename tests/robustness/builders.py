"""How each public class and function of kfit is called, and what its scalar arguments are."""

import importlib
import inspect
import math
import types
import typing
from collections.abc import Callable, Mapping, Sequence
from numbers import Integral, Real
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from kfit.core import FitResult, History
from kfit.fitting.pipeline import FitPipeline

ROOMS = (
    "baselines", "callbacks", "core", "data", "energies", "features", "fitting", "generators", "geometry",
    "initializers", "metrics", "models", "optimizers", "pose", "segmentation", "selectors", "tracking", "training",
)  # fmt: skip
# Plain values that functions give back, and files' readers, whose files tests of their own damage.
ASIDE = {
    "Alternative", "Card", "Category", "Detections", "Evaluation", "FitError", "FitResult", "FitState", "TrackedPose",
    "Tracker", "Frame", "History", "MaskRCNN", "Mesh", "NOCSFrame", "NOCSFrames", "NOCSObject", "NOCSPrediction",
    "NOCSScores", "Observation", "OnnxGenerator", "OnnxNetwork", "Photo", "PoseResult", "Rendering", "SalientObject",
    "Segment", "View", "ViewPairs", "Views", "YoloSeg", "CategoryModel", "Evaluate", "Linearization",
    "GradientEvaluation", "PicturesEvaluation", "ResidualEvaluation", "PoseUpdate",
}  # fmt: skip
EYES, ONES, MANY = torch.eye(3).repeat(2, 1, 1), torch.ones(2), np.eye(20, 3)


def tiny():
    """Networks that are built in no time."""
    from kfit.baselines import CoordinateRegressor, OrientationRegressor
    from kfit.features import EfficientNetLite0, PoseRefiner
    from kfit.generators import VAE3D, ConvEncoder, ExtentsHead, RotationHead

    return {
        "generator": VAE3D(2, (4, 4), 4, (4,)),
        "encoder": ConvEncoder(2, (4, 4), 4, 8),
        "extents": ExtentsHead(2, 4),
        "head": RotationHead(channels=(4, 4), hidden_dim=4, bin_deg=90, image_size=8),
        "regressor": CoordinateRegressor(channels=(4, 4), num_bins=2),
        "orientation": OrientationRegressor(hidden_dim=4, image_size=32),
        "features": EfficientNetLite0((0,)),
        "refiner": PoseRefiner(None, (4, 4), 4, 8),
    }


def result():
    """What a fit of one problem found."""
    code = {"code": torch.zeros(1, 2)}
    zero, nothing = torch.zeros(1, dtype=torch.long), History(torch.zeros(1, 1, 1), {}, {})
    return FitResult(code, torch.zeros(1), zero, zero, zero, torch.zeros(1), code, nothing)


def arguments() -> dict[str, dict]:
    """What classes must be given, and what makes them small."""
    from kfit.core import Positive
    from kfit.energies import L1
    from kfit.initializers import Constant
    from kfit.optimizers import Adam

    small = tiny()
    dims, side = {"code_dim": 2}, {"image_size": 8}
    return {
        "Activations": {"network": nn.Sequential(nn.ReLU()), "layers": ["0"]},
        "BendingEnergy": {"on": "flow"},
        "Bounded": {"low": 0.0, "high": 1.0},
        "ConditionalVAE": {k: small[k] for k in ("generator", "encoder", "extents")} | {"losses": {"image": L1()}},
        "Constant": {"values": {"code": 0.0}},
        "ConvEncoder": {**dims, "channels": (4, 4), "hidden_dim": 4, **side},
        "CoordinateRegressor": {"channels": (4, 4), "num_bins": 4},
        "CoordinateTraining": {"regressor": small["regressor"]},
        "Cosine": {"start": 1.0, "end": 0.0},
        "Crop": {"centre": (1.0, 1.0), "side": 2.0},
        "EncoderPosterior": {"encoder": small["encoder"]},
        "ExtentsHead": {**dims, "hidden_dim": 4},
        "FeatureEncoder": {**dims, "features": small["features"], "feature_dim": 2, "hidden_dim": 4},
        "FitPipeline": {
            "generator": small["generator"], "energies": {"image": L1()}, "optimizer": Adam(),
            "initializers": [Constant(dict.fromkeys(("code", "azimuth", "elevation"), 0.0))],
        },
        "FromDepth": {"generator": small["generator"], "initializers": []},
        "GaussNewton": {"lengths": {"code": 1.0}},
        "LearnedScore": {"refiner": small["refiner"]},
        "LearnedSteps": {"refiner": small["refiner"]},
        "LensPrior": {"diagonal": 0.2, "unit_fraction": 1.0},
        "Light": {"ambient": np.ones(3), "directions": np.zeros((0, 3)), "colors": np.zeros((0, 3))},
        "Linear": {"start": 1.0, "end": 0.0},
        "MeshRenderer": {
            "vertices": np.eye(3), "faces": np.array([[0, 1, 2]]), "uv": np.zeros((3, 2)),
            "texture": np.zeros((2, 2, 3), np.uint8), "num_points": 8, **side,
        },
        "MeshInCamera": {
            "vertices": np.eye(3), "faces": np.array([[0, 1, 2]]), "uv": np.zeros((3, 2)),
            "texture": np.zeros((2, 2, 3), np.uint8), "num_points": 8, "image_size": (8, 8),
        },
        "MetricDepth": {"generator": wrapped(small["generator"]), "unit_fraction": 1.0},
        "MultiView": {"generator": wrapped(small["generator"]), "unit_fraction": 1.0, **side},
        "OrientationRegressor": {"hidden_dim": 4, "image_size": 32},
        "OrientationTraining": {"regressor": small["orientation"]},
        "Perceptual": {"network": small["features"]},
        "PoseHead": {"channels": (4, 4), "hidden_dim": 4, "bin_deg": 45.0, **side},
        "PoseRefiner": {"channels": (4, 4), "hidden_dim": 4, "image_size": 8, "weights": None},
        "PosePosterior": {"head": small["head"]},
        "PosePrior": {"head": small["head"]},
        "PoseTraining": {"pose_head": small["head"]},
        "Previous": {"result": result()},
        "RandomCrop": {},
        "RefinerTraining": {"refiner": small["refiner"], "networks": dict.get},
        "RotationHead": {"channels": (4, 4), "hidden_dim": 4, "bin_deg": 45.0, **side},
        "Pruning": {"keep": {1: 2}},
        "Pyramid": {"energy": L1()},
        "RadianceField": {**dims, "volume_dims": (4, 4), **side},
        "ResidualPyramid": {"energy": L1()},
        "SimilarityWarp": {"generator": small["generator"]},
        "Stages": {"stages": [(Adam(), 1)]},
        "Step": {"weights": [1.0, 0.1], "at": [0.5]},
        "Template": {"picture": torch.zeros(3, 4, 4)},
        "TorchOptimizer": {"optimizer": torch.optim.Adam, "lr": 0.1},
        "TotalVariation": {"on": "flow"},
        "Uniform": {"on": "code", "low": 0.0, "high": 1.0},
        "VAE2D": {**dims, "decoder_dims": (4, 4)},
        "VAE3D": {**dims, "volume_dims": (4, 4), "projection_dim": 4, "decoder_dims": (4,)},
        "Variable": {"space": Positive()},
        "VolumeTemplate": {"volume": torch.zeros(1, 1, 4, 4, 4)},
    }  # fmt: skip


def wrapped(generator):
    from kfit.generators import SimilarityWarp

    return SimilarityWarp(generator)


def classes() -> dict[str, tuple[Callable, dict]]:
    """Public classes that can be built, each with the arguments that build it."""
    inputs, found = arguments(), {"FitPipeline": FitPipeline}
    for room in ROOMS:
        module = importlib.import_module(f"kfit.{room}")
        for name in getattr(module, "__all__", vars(module)):
            part = getattr(module, name)
            if inspect.isclass(part) and part.__module__.startswith("kfit") and not inspect.isabstract(part):
                found[name] = part
    for name in ("dataset_fit.DatasetFit", "photo_folder.PhotoFolder", "nocs_fit.NOCSFit"):
        module, part = name.split(".")
        found[part] = getattr(importlib.import_module(f"kfit.batch.{module}"), part)
    inputs |= {
        "PhotoFolder": {"root": Path("photos"), "category": "mug"},
        "NOCSFit": {"root": Path("nocs"), "split": "real_test"},
    }
    return {name: (part, inputs.get(name, {})) for name, part in sorted(found.items()) if name not in ASIDE}


def functions() -> dict[str, tuple[Callable, dict]]:
    """Public functions with scalar arguments, each with the others."""
    from kfit import geometry
    from kfit.data import align, build, build_views, pose_view
    from kfit.metrics import average_precision, rotation_error_deg
    from kfit.segmentation import mask_near

    mesh, light = build("bowl", 0)
    return {
        "align": (align, {"coordinates": MANY, "points": MANY}),
        "average_precision": (average_precision, {"matched": np.ones(2, bool), "num_truths": 2}),
        # a path that can be no folder: what is accepted ends there, and renders nothing
        "build_views": (build_views, {"path": "/dev/null/v.h5", "source": "bowl", "num_objects": 1, "num_views": 2}),
        "energy_weights": (geometry.energy_weights, {"energy": ONES}),
        "intrinsics_from_fov": (geometry.intrinsics_from_fov, {"width": 4, "height": 3}),
        "mask_near": (mask_near, {"image": np.zeros((8, 8, 3), np.float32), "silhouette": np.eye(8), "band": 1}),
        "pose_view": (pose_view, {"mesh": mesh, "elevation": 0.5, "azimuth": 0.5, "light": light, "image_size": 8}),
        "rotation_clusters": (geometry.rotation_clusters, {"rotation": EYES, "energy": ONES}),
        "rotation_error": (geometry.rotation_error, {"a": EYES, "b": EYES}),
        "rotation_error_deg": (rotation_error_deg, {"prediction": EYES, "target": EYES}),
    }


def scalars(part: Callable) -> dict[str, object]:
    """Arguments that are numbers, switches, words, or lists and dicts of those, with their types."""
    hints = typing.get_type_hints(part if not inspect.isclass(part) or "__init__" not in vars(part) else part.__init__)
    if inspect.isclass(part) and "__init__" not in vars(part):
        hints = typing.get_type_hints(next(c for c in part.__mro__ if "__init__" in vars(c)).__init__) or hints
    names = [name for name, p in inspect.signature(part).parameters.items() if p.kind not in (2, 4)]
    found = {name: hints[name] for name in names if name in hints and plain(hints[name])}
    return {name: hint for name, hint in found.items() if name != "path"}  # where something would be written


def plain(hint) -> bool:
    if typing.get_origin(hint) is typing.Literal:
        return True
    if parts := [part for part in typing.get_args(hint) if part is not Ellipsis]:
        return all(plain(part) or part is Tensor for part in parts) and any(plain(part) for part in parts)
    return hint in (int, float, bool, str, Path, type(None))


def fits(hint, value) -> bool:
    """Whether a value is of a type, booleans being no numbers and NaN and infinity none either."""
    origin, parts = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        return any(fits(part, value) for part in parts)
    if origin is typing.Literal:
        return any(type(value) is type(part) and value == part for part in parts)
    if origin in (dict, Mapping):
        return isinstance(value, Mapping) and all(fits(parts[0], k) and fits(parts[1], v) for k, v in value.items())
    if origin is tuple and Ellipsis not in parts:
        return isinstance(value, Sequence) and len(value) == len(parts) and all(map(fits, parts, value))
    if origin is not None:
        return isinstance(value, Sequence) and not isinstance(value, str) and all(fits(parts[0], v) for v in value)
    if hint in (int, float):
        kind = Integral if hint is int else Real
        return isinstance(value, kind) and not isinstance(value, bool) and (hint is int or math.isfinite(value))
    if hint is Path:
        return isinstance(value, str | Path)
    if hint is Tensor:
        return isinstance(value, Tensor) and bool(value.isfinite().all())
    return value is None if hint is type(None) else isinstance(value, hint)
