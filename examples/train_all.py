"""Train models of all six categories, generator and pose head, and pack each into RUNS/NAME.safetensors.

    python examples/train_all.py RUNS [mug laptop …] [--trainer.max_epochs 5 …]

Categories are those named, or all; words from the first that begins with -- on go to every `lightning fit`, whose
recipes tell the usual budget: on one CPU core two hours for the generator and a quarter of one for the head, minutes on
a GPU. Started again, it goes on where it was stopped. Two of them share two cores, given different categories.
"""

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from kfit.geometry import CATEGORIES

RECIPES = Path(__file__).parents[1] / "recipes"
PARTS = {"generator": "radiance_field.yaml", "pose_head": "pose_head.yaml"}


def kfit(*words: object) -> None:
    """Run a kfit command to its end."""
    subprocess.run([sys.executable, "-m", "kfit", *map(str, words)], check=True)


def trained(part: str, category: str, folder: Path, settings: Sequence[str]) -> Path:
    """The last checkpoint of a part, trained to its end."""
    folder = folder / category / part
    begun = sorted(folder.glob("lightning_logs/version_*/checkpoints/last.ckpt"), key=os.path.getmtime)
    resume = ["--ckpt_path", begun[-1]] if begun else []
    recipe = ["-c", RECIPES / PARTS[part], "--data.category", category, "--trainer.default_root_dir", folder]
    kfit("fit", *recipe, *settings, *resume)
    return max(folder.glob("lightning_logs/version_*/checkpoints/last.ckpt"), key=os.path.getmtime)


def main(folder: str, *words: str) -> None:
    """Train and pack what is not packed yet."""
    split = next((i for i, word in enumerate(words) if word.startswith("--")), len(words))
    for category in words[:split] or CATEGORIES:
        model = Path(folder) / f"{category}.safetensors"
        if not model.is_file():
            generator, head = (trained(part, category, Path(folder), words[split:]) for part in PARTS)
            command = "; ".join(
                f"lightning fit -c recipes/{name} " + " ".join(["--data.category", category, *words[split:]])
                for name in PARTS.values()
            )
            kfit("pack", generator, "--pose-head", head, "--out", model, "--command", command)


if __name__ == "__main__":
    if len(sys.argv) < 2 or sys.argv[1].startswith("-"):
        sys.exit(__doc__)
    main(*sys.argv[1:])
