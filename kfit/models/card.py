"""What a model file says about itself."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

from kfit.core.check import check_names
from kfit.geometry import CATEGORIES, Category
from kfit.models.calibration import Calibration

FORMAT = 1
# Of fits that a calibration may be of: to colour alone, and to depth too.
KINDS = ("RGB", "RGB-D")


@dataclass
class Card:
    """The JSON beside a model's weights.

    Attributes:
        category: one of the NOCS categories.
        networks: class and arguments of ``generator``, ``encoder`` and ``extents``, as recipes write them.
        distance: of the training camera from the object's centre, in box diagonals.
        unit_fraction: share of the picture's width that a unit diagonal at the object's centre spans, at scale 1.
        elevation_deg: range of elevations seen in training.
        axes: how the object stands in its frame, in words.
        symmetry: ``"none"`` or ``"y"``.
        mean_diagonal: in metres; what translation and size from colour alone rest on.
        pose_weight: of what the pose head says, beside the energies of the picture.
        training: command, data, number of pairs, seed, versions.
        accuracy: measured figures, by the name of what they were measured on.
        calibration: what confidence rests on, for fits of ``"RGB"`` and of ``"RGB-D"``, as far as `kfit calibrate`
            measured them.
        format: version of this layout.
    """

    category: str
    networks: dict[str, dict[str, Any]]
    distance: float
    unit_fraction: float
    elevation_deg: tuple[float, float]
    axes: str
    symmetry: str
    mean_diagonal: float
    pose_weight: float = 2.0
    training: dict[str, Any] = field(default_factory=dict)
    accuracy: dict[str, Any] = field(default_factory=dict)
    calibration: dict[str, Calibration] = field(default_factory=dict)
    format: int = FORMAT

    @property
    def known(self) -> Category:
        """The category's entry in `kfit.geometry.CATEGORIES`."""
        return CATEGORIES[self.category]

    def write(self, path: Path) -> None:
        """Write the card as JSON."""
        path.write_text(json.dumps(asdict(self), indent=2) + "\n")

    @staticmethod
    def read(path: Path) -> Card:
        """Read a card.

        Raises:
            FileNotFoundError: if there is no such file.
            ValueError: if it is not a card of this version.
        """
        if not path.is_file():
            raise FileNotFoundError(f"no model card at {path}; a model is two files, NAME.safetensors and NAME.json")
        try:
            said = json.loads(path.read_text())
        except (json.JSONDecodeError, UnicodeDecodeError) as error:
            raise ValueError(f"{path} is not a model card: {error}") from None
        names = {f.name for f in fields(Card)}
        if isinstance(said, dict):
            said = {"calibration": {}, **said}  # cards from before there were any
        if not isinstance(said, dict) or set(said) != names or said["format"] != FORMAT:
            raise ValueError(
                f"{path} is not a model card of format {FORMAT}: it must hold just {', '.join(sorted(names))}"
            )
        if said["category"] not in CATEGORIES:
            raise ValueError(f"{path} names category {said['category']!r}; those known are {', '.join(CATEGORIES)}")
        try:
            if not isinstance(said["calibration"], dict):
                raise ValueError("it must be a dictionary")
            check_names("calibration", said["calibration"], KINDS)
            calibration = {kind: Calibration.of(one) for kind, one in said["calibration"].items()}
        except ValueError as error:
            raise ValueError(f"{path} holds a calibration that cannot be used: {error}") from None
        return Card(**{**said, "elevation_deg": tuple(said["elevation_deg"]), "calibration": calibration})
