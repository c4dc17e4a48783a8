"""Provenance stored in checkpoints: versions, state of the code, recipe, data, seed and machine."""

from __future__ import annotations

import os
import platform
import subprocess
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import lightning
import torch
from lightning.pytorch import Callback, LightningModule, Trainer

import kfit


class Provenance(Callback):
    """Writes the provenance of the training into each checkpoint, under ``kfit``; `kfit pack` takes it into the card.

    Args:
        recipe: the complete recipe as YAML; ``lightning`` sets it. Without one the checkpoint holds only the arguments
            of module and data, as Lightning stores them.
    """

    def __init__(self, recipe: str | None = None) -> None:
        if recipe is not None and not isinstance(recipe, str):
            raise TypeError(f"Provenance: recipe must be text, got {type(recipe).__name__}")
        self.recipe = recipe
        self.facts: dict[str, Any] = {}

    def on_fit_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        fingerprint = getattr(trainer.datamodule, "fingerprint", None)  # type: ignore[attr-defined]
        seed = os.environ.get("PL_GLOBAL_SEED")
        device = pl_module.device
        self.facts = {
            "kfit": kfit.__version__,
            "python": platform.python_version(),
            "torch": str(torch.__version__),  # a class of torch's own
            "lightning": lightning.__version__,
            "code": git_state(Path.cwd()),
            "kfit_code": git_state(Path(kfit.__file__).parent),
            "recipe": self.recipe,
            "data": fingerprint() if callable(fingerprint) else None,
            "seed": None if seed is None else int(seed),
            "device": torch.cuda.get_device_name(device) if device.type == "cuda" else platform.machine(),
            "processes": trainer.world_size,
            "precision": str(trainer.precision),
            "started": datetime.now(UTC).isoformat(timespec="seconds"),
        }

    def on_save_checkpoint(self, trainer: Trainer, pl_module: LightningModule, checkpoint: dict[str, Any]) -> None:
        checkpoint["kfit"] = self.facts


def git_state(folder: Path) -> dict[str, Any] | None:
    """Return the commit of a folder and whether files differ from it; None outside a repository.

    Args:
        folder: any folder in a Git repository.
    """
    try:
        commit, changes = (
            subprocess.run(["git", *words], cwd=folder, capture_output=True, text=True, timeout=10, check=True).stdout
            for words in (["rev-parse", "HEAD"], ["status", "--porcelain", "--untracked-files=no"])
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return {"commit": commit.strip(), "changed": bool(changes.strip())}
