"""Loading a model by its category or its path."""

from __future__ import annotations

import logging
from pathlib import Path

import torch

from kfit.core import Encoder, Generator
from kfit.pose.category_model import CategoryModel
from kfit.pose.model_files import read_model
from kfit.runtime.devices import safe_after_fork

_log = logging.getLogger(__name__)
BUNDLED = Path(__file__).parent / "bundled"


def bundled() -> list[str]:
    """Return the categories whose models come with kfit.

    Example:
        >>> from kfit.models import bundled
        >>> bundled()
        ['bottle', 'bowl', 'camera', 'can', 'laptop', 'mug']
    """
    return sorted(path.stem for path in BUNDLED.glob("*.safetensors"))


@safe_after_fork()
@torch.inference_mode(False)
def load(model: str | Path) -> CategoryModel:
    """Load a bundled model by its category, or one of your own by the path of its .safetensors file.

    Its networks compute in single precision, whatever torch's default type is. Torch's random state is not changed.

    Raises:
        ValueError: if the category has no bundled model, or a file is damaged.
        FileNotFoundError: if a file is missing.

    Example:
        >>> import kfit
        >>> model = kfit.load("mug")
        >>> model.card.mean_diagonal  # in metres
        0.17
    """
    name = str(model)
    if not name.endswith(".safetensors"):
        if name not in bundled():
            raise ValueError(f"category {name!r} has no bundled model; those known are {', '.join(bundled())}")
        name = str(BUNDLED / f"{name}.safetensors")
    _log.debug("reads the model %s", name)
    networks, card = read_model(Path(name))
    return CategoryModel(**networks, card=card)  # type: ignore[arg-type]


def generator_and_encoder(model: str | Path) -> tuple[Generator, Encoder]:
    """Return the two networks of a model that draw its category; the argument and errors are those of `load`.

    Example:
        >>> generator, encoder = generator_and_encoder("can")
        >>> generator.variables["code"].shape
        (16,)
    """
    found = load(model)
    return found.generator, found.encoder
