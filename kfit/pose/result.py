"""The result of pose estimation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from kornia.geometry.conversions import rotation_matrix_to_quaternion
from numpy.typing import NDArray

from kfit.core import FitResult, Observation, Rendering, Variables
from kfit.generators.surface import Surface
from kfit.geometry import Crop

if TYPE_CHECKING:
    from trimesh import Trimesh


@dataclass(frozen=True)
class Alternative:
    """One of the distinct poses that the fit found.

    Attributes:
        rotation: (3, 3).
        energy: energy of its best start.
        weight: fraction of the surviving starts' weight, in [0, 1]; the alternatives' weights sum to 1.
        sigma_deg: weighted angular standard deviation of its starts about the best one.

    Example:
        >>> import numpy as np
        >>> from kfit.pose import Alternative
        >>> Alternative(np.eye(3), energy=0.4, weight=0.9, sigma_deg=3.0).weight
        0.9
    """

    rotation: NDArray[np.float64]
    energy: float
    weight: float
    sigma_deg: float


@dataclass(frozen=True)
class PoseResult:
    """Pose, size and appearance of one object in one photo.

    Attributes:
        category: category of the model.
        symmetry: symmetry of the category, see `kfit.geometry.Category`.
        front: front of the category, likewise.
        rotation: (3, 3), object (NOCS axes, y up) to camera (OpenCV: x right, y down, z forward).
        translation: (3,) of the object's centre, in metres.
        size: (3,) sides of the object's box along its own axes, in metres.
        size_from: source of size and distance: "depth", "views" of several cameras, or the category's "mean size".
        bbox_xywh: left, top, width, height of the mask's box, in pixels.
        energy: energy of the winning start; lower is better.
        confidence: probability in [0, 1] that the rotation is within 20° of the truth, calibrated on held-out
            procedural views; if the model or the fit has no calibration, as a note then reports, the answer's weight.
        calibrated: whether the confidence is such a probability.
        ambiguous: whether other poses explain the picture about as well; a note names one.
        alternatives: distinct poses, the answer first, then by weight.
        intrinsics: (3, 3) of the translation.
        intrinsics_from: "given", "EXIF", or "estimated" if the focal length was fitted.
        focal_log_sd: standard deviation of the logarithm of the focal length: 0 if it was an argument.
        notes: sentences on assumptions and possible errors.
        image: (H, W, 3) RGB in [0, 1], the photo.
        mask: (H, W) that was used.
        crop: the fitted square.
        observation: its content.
        drawing: (S, S, 3) the winner's picture.
        fit: the result of the fit.
        draw: draws N values of the fit, such as those of a start over the steps.
        find_covariance: computes `covariance`.
        category_score: probability in [0, 1] that the object is of the category, by its appearance; None if it was not
            checked.
        surface: computes the fitted object's surface; None if the model's generator has none.

    Example:
        >>> import numpy as np, kfit
        >>> image, mask = np.ones((96, 96, 3)), np.zeros((96, 96))
        >>> image[20:80, 30:70], mask[20:80, 30:70] = (0.7, 0.2, 0.1), 1
        >>> model = kfit.load("mug")
        >>> short = model.pipeline(num_starts=1, num_steps=1)  # for this example
        >>> result = model.pose(image, mask=mask, pipeline=short)
        >>> result.category, result.bbox_xywh, result.size_from, result.intrinsics_from
        ('mug', (30, 20, 40, 60), 'mean size', 'estimated')
    """

    category: str
    symmetry: str
    front: str | None
    rotation: NDArray[np.float64]
    translation: NDArray[np.float64]
    size: NDArray[np.float64]
    size_from: str
    bbox_xywh: tuple[int, int, int, int]
    energy: float
    confidence: float
    calibrated: bool
    ambiguous: bool
    alternatives: list[Alternative]
    intrinsics: NDArray[np.float64]
    intrinsics_from: str
    focal_log_sd: float
    notes: list[str]
    image: NDArray[np.float32] = field(repr=False)
    mask: NDArray[np.float32] = field(repr=False)
    crop: Crop = field(repr=False)
    observation: Observation = field(repr=False)
    drawing: NDArray[np.float32] = field(repr=False)
    fit: FitResult = field(repr=False)
    draw: Callable[[Variables], Rendering] = field(repr=False)
    find_covariance: Callable[[], NDArray[np.float64]] = field(repr=False)
    category_score: float | None = None
    surface: Callable[[], Surface] | None = field(default=None, repr=False)

    @property
    def quaternion_wxyz(self) -> NDArray[np.float64]:
        """The rotation as a unit quaternion, with a real part first and at least 0."""
        quaternion: NDArray[np.float64] = rotation_matrix_to_quaternion(torch.from_numpy(self.rotation)[None])[
            0
        ].numpy()
        return quaternion if quaternion[0] >= 0 else -quaternion

    @cached_property
    def covariance(self) -> NDArray[np.float64]:
        """Return the covariance (6, 6), positive definite, of (ω, τ) in the photo's camera (OpenCV axes).

        The true pose is R = exp([ω]×) · ``rotation`` and t = ``translation`` + τ: ω is a rotation vector in radians,
        applied on the left, about the camera's axes through the object's centre, and τ is in metres. Rotation comes
        first: ``covariance[:3, :3]`` is in rad², ``covariance[3:, 3:]`` in m².

        It is the sum of the uncertainty of the drawing's pixels near the answer, the scatter of the surviving starts,
        the focal length's deviation and, mostly along the viewing ray, the size's; the module ``kfit.pose.covariance``
        has the formula. It describes answers that are right or among the surviving starts; ``confidence`` is the
        probability that the rotation is right. It is multiplied by a factor that `kfit calibrate` measures on held-out
        views, so that the 95 % ellipsoids hold 95 % of right answers. Where a model's card has none, the factor is 1.7:
        without it, the ellipsoids held 60 of 75 mugs and 71 of 72 bottles; with it, 22 of 22 mugs.

        The rotation of a symmetric object about its vertical axis a = ``rotation[:, 1]`` is unobservable. Along (a, 0)
        the matrix has the variance π²/3 of a uniform distribution over the circle, without correlations.

        It is computed at the first access, from seven drawings without a gradient.
        """
        return self.find_covariance()

    def mesh(self) -> Trimesh:
        """Return the fitted object's surface, with a colour at each vertex, in metres about its box's centre, y up.

        ``rotation`` and ``translation`` map it to the photo's camera. It is an isosurface of the generator's density,
        by marching cubes: as smooth as the drawings, and extrapolated where the photo does not show the object.

        Raises:
            ValueError: if the model's generator has no volume, or the fitted one is empty.
        """
        from trimesh import Trimesh

        if self.surface is None:
            raise ValueError(f"the model of {self.category} draws without a volume, so it has no surface")
        surface = self.surface()
        metres = surface.vertices * float(np.linalg.norm(self.size))
        colors = (255 * surface.colors).round().astype(np.uint8)
        return Trimesh(metres, surface.faces, vertex_colors=colors, process=False)

    def to_dict(self) -> dict[str, Any]:
        """Return the content of ``pose.json``: numbers, lists and strings only."""
        return {
            "category": self.category,
            "category_score": self.category_score,
            "symmetry": self.symmetry,
            "rotation": self.rotation.tolist(),
            "quaternion_wxyz": self.quaternion_wxyz.tolist(),
            "translation": self.translation.tolist(),
            "covariance": self.covariance.tolist(),
            "size": self.size.tolist(),
            "size_from": self.size_from,
            "bbox_xywh": list(self.bbox_xywh),
            "energy": self.energy,
            "confidence": self.confidence,
            "calibrated": self.calibrated,
            "ambiguous": self.ambiguous,
            "alternatives": [
                {"rotation": a.rotation.tolist(), "energy": a.energy, "weight": a.weight, "sigma_deg": a.sigma_deg}
                for a in self.alternatives
            ],
            "intrinsics": self.intrinsics.tolist(),
            "intrinsics_from": self.intrinsics_from,
            "intrinsics_assumed": self.intrinsics_from == "estimated",
            "focal_length_px": float(self.intrinsics[0, 0] + self.intrinsics[1, 1]) / 2,
            "focal_log_sd": self.focal_log_sd,
            "notes": self.notes,
        }
