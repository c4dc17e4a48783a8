"""Atomic checkpoints, also if a disk fills up or a training is killed during writing."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import Any

import torch
from lightning.fabric.plugins import TorchCheckpointIO

from kfit.runtime.atomic_write import atomic_write


class AtomicCheckpoints(TorchCheckpointIO):
    """Writes each checkpoint to a temporary file, and moves it to its place once it is on disk.

    Lightning writes it to the folder of temporary files and, if that is on another disk, copies it over the last one:
    an interrupted copy destroys both.
    """

    def save_checkpoint(self, checkpoint: dict[str, Any], path: str | Path, storage_options: Any | None = None) -> None:
        """Write a checkpoint; one that goes to a store on the network as Lightning does.

        Raises:
            OSError: naming the file, if the disk is full; the previous checkpoint is kept.
        """
        if "://" in str(path):
            super().save_checkpoint(checkpoint, path, storage_options)
            return
        # From memory, because torch's writer does not report the system's error.
        written, place = BytesIO(), Path(path)
        torch.save(checkpoint, written)
        atomic_write(place.parent, {place.name: lambda aside: aside.write_bytes(written.getbuffer())})
