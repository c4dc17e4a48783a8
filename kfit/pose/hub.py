"""Models on the Hugging Face Hub, in its local cache, or in a folder with a Hub repository's layout."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kfit.core.arguments import check_arguments
from kfit.runtime.atomic_write import atomic_write

if TYPE_CHECKING:
    from kfit.pose.card import Card

MODEL, CHECKSUM, PAGE = "model.safetensors", "model.safetensors.sha256", "README.md"
_NEEDS = "sharing models needs the package huggingface_hub: pip install 'kfit[hub]'"


def find_model(name: str | Path, revision: str | None = None, offline: bool = False) -> Path:
    """Find a shared model's file, and check that it is the one that was shared.

    Args:
        name: a folder that `save_folder` wrote, or ``user/name`` of a repository on the Hub.
        revision: branch, tag or commit of the repository.
        offline: use only the Hub's local cache, without network access.

    Returns:
        Path of the .safetensors file.

    Raises:
        ImportError: For a repository, if huggingface_hub is not installed.
        FileNotFoundError: if there is no such model.
        ValueError: If its content does not match its checksum.
    """
    check_arguments(find_model, locals())
    folder = Path(name)
    if folder.is_dir():
        model, checksum = folder / MODEL, folder / CHECKSUM
        if not model.is_file():
            raise FileNotFoundError(f"{folder} is no folder of a shared model: it has no {MODEL}")
        if not checksum.is_file():
            raise FileNotFoundError(f"{folder} has no {CHECKSUM}, by which {MODEL} is checked")
    else:
        model, checksum = (_fetched(str(name), file, revision, offline) for file in (MODEL, CHECKSUM))
    wanted = checksum.read_text(encoding="utf-8", errors="replace")[:64]
    with model.open("rb") as file:
        found = hashlib.file_digest(file, "sha256").hexdigest()
    if found != wanted:
        raise ValueError(
            f"{name}: {MODEL} is damaged or was replaced: its SHA-256 begins with {found[:12]}, not {wanted[:12]}"
        )
    return model


def save_folder(folder: str | Path, content: bytes, card: Card) -> Path:
    """Write a model's file, its checksum and a page about it into a folder atomically.

    Args:
        folder: path of the folder, created if needed.
        content: content of the .safetensors file.
        card: card of the model.
    """
    digest, page = hashlib.sha256(content).hexdigest(), model_page(card)
    writers: dict[str, Any] = {
        MODEL: lambda path: path.write_bytes(content),
        CHECKSUM: lambda path: path.write_text(f"{digest}  {MODEL}\n"),
        PAGE: lambda path: path.write_text(page, encoding="utf-8"),
    }
    atomic_write(Path(folder), writers)
    return Path(folder)


def upload(folder: Path, name: str, private: bool) -> str:
    """Upload a folder that `save_folder` wrote as a repository of the Hub, with the user's login.

    Returns:
        Address of the commit.

    Raises:
        ImportError: If huggingface_hub is not installed.
        OSError: if the Hub refuses or cannot be reached.
    """
    hub = _hub()
    try:
        hub.create_repo(name, private=private, exist_ok=True)
        return str(hub.upload_folder(repo_id=name, folder_path=folder, commit_message="Model of kfit"))
    except (OSError, ValueError) as error:
        raise OSError(f"{name} cannot be uploaded: {' '.join(str(error).split())}") from error


def model_page(card: Card) -> str:
    """Build the page of a repository: the model's category, its training data and its use."""
    known, provenance = card.known, card.training.get("provenance") or {}
    lines = [
        "---",
        "library_name: kfit",
        "tags: [object-pose-estimation, analysis-by-synthesis]",
        "---",
        f"# {known.name}: a category model of kfit",
        "",
        f"Finds the pose of a {known.name} in a photo. Axes: {known.axes}. Symmetry: {known.symmetry}.",
        f"Mean diagonal of the box: {known.mean_diagonal:g} m.",
        "",
        "```python",
        "from kfit.pose import CategoryModel",
        "",
        'model = CategoryModel.from_pretrained("USER/NAME")',
        'print(model.pose("photo.jpg", box=(120, 80, 300, 260)).rotation)',
        "```",
        "",
        "## Training",
        "",
        f"- steps: {card.training.get('steps', 'unknown')}, pairs: {card.training.get('pairs', 'unknown')}",
        *(f"- {key}: {provenance[key]}" for key in ("kfit", "torch", "code", "data", "seed", "device") if provenance),
        "",
        "## Measured",
        "",
        "```json",
        json.dumps(card.accuracy, indent=1),
        "```",
    ]
    return "\n".join(lines) + "\n"


def _fetched(name: str, file: str, revision: str | None, offline: bool) -> Path:
    if name.count("/") != 1:
        raise FileNotFoundError(f"there is no folder {name}, and a repository is named as user/name")
    hub = _hub()
    try:
        return Path(hub.hf_hub_download(name, file, revision=revision, local_files_only=offline))
    except (OSError, ValueError) as error:
        raise FileNotFoundError(f"{name} has no {file} that can be had: {' '.join(str(error).split())}") from error


def _hub() -> Any:
    try:
        import huggingface_hub
    except ImportError:
        raise ImportError(_NEEDS) from None
    return huggingface_hub
