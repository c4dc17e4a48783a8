"""Writing whatever card into a model's file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from safetensors.torch import load, save

from kfit.pose.model_files import METADATA, read_card


def put_card(path: Path, card: str | dict[str, Any], source: Path | None = None) -> None:
    """Write ``source``, unless given the file at ``path`` itself, to ``path`` with another card."""
    numbers = load((source or path).read_bytes())
    path.write_bytes(save(numbers, {METADATA: card if isinstance(card, str) else json.dumps(card)}))


def card_of(path: Path) -> dict[str, Any]:
    """What a model's card holds, as plain values."""
    card: dict[str, Any] = json.loads(read_card(path).to_json())
    return card


def as_version_01(path: Path) -> None:
    """Move a file's card to a JSON file, as version 0.1 wrote it."""
    path.with_suffix(".json").write_text(read_card(path).to_json() + "\n")
    path.write_bytes(save(load(path.read_bytes())))
