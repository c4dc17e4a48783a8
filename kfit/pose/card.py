"""The model card of a model file."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

from kfit.core.arguments import check_arguments
from kfit.core.check import check_dict, check_names
from kfit.geometry import CATEGORIES, Category
from kfit.pose.confidence import Calibration

FORMAT = 1
# Kinds of fits with a calibration: to colour alone, and to colour and depth.
KINDS = ("RGB", "RGB-D")
NETWORKS = ("generator", "encoder", "extents")
OPTIONAL = ("pose_head",)
# Fields of `kfit.geometry.Category` that are the card's own too.
OF_CATEGORY = (
    *("mean_diagonal", "symmetry", "diagonals", "unit_fraction", "sides", "axes", "elevation_deg", "upright"),
    *("mirror", "shapes", "front"),
)
# Characters; bundled cards have some thousands.
LARGEST = 10_000_000


@dataclass(frozen=True)
class Card:
    """Description of a model, stored as JSON in the metadata of its file; ``dataclasses.replace`` makes a changed one.

    Attributes:
        category: its name; `known` has all that the card holds of it.
        networks: class and arguments of ``generator``, ``encoder`` and ``extents``, as in recipes.
        distance: distance of the training camera from the object's centre, in box diagonals.
        unit_fraction: fraction of the picture's width that a unit diagonal at the object's centre spans, at scale 1.
        elevation_deg: range of elevations in training.
        axes: orientation of the object in its frame, in words.
        symmetry: as in `kfit.geometry.Category`, and so are ``diagonals``, ``sides``, ``upright``, ``mirror``,
            ``shapes`` and ``front``.
        mean_diagonal: in metres; it determines translation and size from colour alone.
        pose_weight: weight of the pose head's prior relative to the energies of the picture.
        training: command, data, number of pairs, seed, versions.
        accuracy: measured figures, by the name of the test set.
        calibration: calibration of the confidence, for fits of ``"RGB"`` and of ``"RGB-D"``, if `kfit calibrate`
            measured it.
        format: version of this layout.

    Example:
        >>> from kfit.models import read_card
        >>> from kfit.models.load import BUNDLED
        >>> card = read_card(BUNDLED / "mug.safetensors")
        >>> card.category, card.symmetry, sorted(card.networks)
        ('mug', 'none', ['encoder', 'extents', 'generator', 'pose_head'])
    """

    category: str
    networks: Mapping[str, Mapping[str, Any]]
    distance: float
    unit_fraction: float
    elevation_deg: tuple[float, float]
    axes: str
    symmetry: str
    mean_diagonal: float
    diagonals: tuple[float, float] | None = None
    sides: tuple[float, float, float] = (1.0, 1.0, 1.0)
    upright: float = 0.5
    mirror: bool = True
    shapes: str | None = None
    front: str | None = None
    pose_weight: float = 2.0
    training: Mapping[str, Any] = field(default_factory=dict)
    accuracy: Mapping[str, Any] = field(default_factory=dict)
    calibration: Mapping[str, Calibration] = field(default_factory=dict)
    format: int = FORMAT

    def __post_init__(self) -> None:
        check_dict("networks", self.networks, check_dict, _anything)
        check_names("networks", self.networks, (*NETWORKS, *OPTIONAL))
        check_arguments(Card, vars(self), distance=(1, 1e6), pose_weight=(0, 1e6))
        check_dict("training", self.training, _anything)
        check_dict("accuracy", self.accuracy, _anything)
        known = self.known  # which checks the fields of the category
        for name in ("elevation_deg", "diagonals", "sides"):
            object.__setattr__(self, name, getattr(known, name))

    @property
    def known(self) -> Category:
        """The category, as the card describes it."""
        fields = {name: getattr(self, name) for name in OF_CATEGORY}
        own = CATEGORIES.get(self.category)
        return Category(self.category, **fields, nocs_id=None if own is None else own.nocs_id)

    @staticmethod
    def fields_of(category: Category) -> dict[str, Any]:
        """Return the fields of the card that describe a category, without its name."""
        return {name: getattr(category, name) for name in OF_CATEGORY}

    def to_json(self) -> str:
        """Return the card as text, which `of_json` reads."""
        return json.dumps(asdict(self), indent=2)

    @staticmethod
    def of_json(text: str, path: Path) -> Card:
        """Read a card from its text.

        Args:
            text: JSON.
            path: path of its file, for messages.

        Raises:
            ValueError: if it is not a card of this version.
        """
        if len(text) > LARGEST:
            raise ValueError(f"{path} holds no model card: it has {len(text):,} characters, more than {LARGEST:,}")
        try:
            content = json.loads(text)
        except (ValueError, RecursionError) as error:
            raise ValueError(f"{path} holds no model card: {error}") from None
        names = {f.name for f in fields(Card)}
        if isinstance(content, dict):
            # Older cards have no calibration, and only the name of their category.
            own = CATEGORIES.get(str(content.get("category")))
            filled = {} if own is None else Card.fields_of(own)
            filled = {name: value for name, value in filled.items() if name not in content}
            content = {"calibration": {}, **filled, **content}
        if not isinstance(content, dict) or set(content) != names or content["format"] != FORMAT:
            raise ValueError(
                f"{path} holds no model card of format {FORMAT}: it must have just {', '.join(sorted(names))}"
            )
        try:
            check_dict("calibration", content["calibration"], _anything)
            check_names("calibration", content["calibration"], KINDS)
            calibration = {kind: Calibration.of(one) for kind, one in content["calibration"].items()}
        except (ValueError, TypeError) as error:
            raise ValueError(f"{path} holds a calibration that cannot be used: {error}") from None
        try:
            card = Card(**{**content, "calibration": calibration})
        except (ValueError, TypeError) as error:
            raise ValueError(f"{path} holds a model card that cannot be used: {error}") from None
        return card


def _anything(name: str, value: object) -> None:
    """Accept anything."""
