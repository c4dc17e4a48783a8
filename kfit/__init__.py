"""kfit fits pictures: generators, energies, initializers, optimizers and selectors, composed into batched fits."""

from __future__ import annotations

from importlib import import_module
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from kfit.core import (
        Callback,
        Encoder,
        Energy,
        FitError,
        FitResult,
        FitState,
        Generator,
        Initializer,
        Observation,
        Optimizer,
        Prior,
        Rendering,
        ResidualEnergy,
        ResidualPrior,
        Schedule,
        Selector,
        Variable,
    )
    from kfit.fitting.pipeline import FitPipeline
    from kfit.models.find_poses import find_poses
    from kfit.models.load import load
    from kfit.registration import register
    from kfit.reports.html_page import report

__version__ = version("kfit")
__all__ = [
    "Callback",
    "Encoder",
    "Energy",
    "FitError",
    "FitPipeline",
    "FitResult",
    "FitState",
    "Generator",
    "Initializer",
    "Observation",
    "Optimizer",
    "Prior",
    "Rendering",
    "ResidualEnergy",
    "ResidualPrior",
    "Schedule",
    "Selector",
    "Variable",
    "__version__",
    "find_poses",
    "load",
    "register",
    "report",
]

# Imported when first asked for: `import kfit` costs nothing, and no part is loaded that is not used.
_HOMES = {name: "kfit.core" for name in __all__ if name[0].isupper()} | {
    "FitPipeline": "kfit.fitting.pipeline",
    "find_poses": "kfit.models",
    "load": "kfit.models",
    "register": "kfit.registration",
    "report": "kfit.reports.html_page",
}


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module 'kfit' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*__all__, *globals()])
