"""Photos that are named on the command line: files, and folders of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

ENDINGS = (".png", ".jpg", ".jpeg", ".webp", ".bmp", ".tif", ".tiff", ".avif", ".heic", ".heif")
# Pictures with these name endings belong to another photo in the folder.
ASIDE = ("_mask", "_depth", "_overlay")


def path_name(text: str) -> str:
    """Return an argument unchanged; jsonargparse would parse items of a list as YAML."""
    return text


def photo_files(names: Sequence[str]) -> list[str]:
    """Files in the order in which they are named; of a folder those that are photos by their endings, by name.

    Raises:
        FileNotFoundError: for a folder without photos.
    """
    found: list[str] = []
    for name in names:
        if not Path(name).is_dir():
            found.append(name)
            continue
        inside = sorted(path for path in Path(name).iterdir() if path.suffix.lower() in ENDINGS)
        photos = [str(path) for path in inside if not path.stem.endswith(ASIDE)]
        if not photos:
            raise FileNotFoundError(f"folder {name} holds no photos: no {', '.join(ENDINGS)}")
        found += photos
    return list(dict.fromkeys(found))
