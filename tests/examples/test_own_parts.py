"""Parts in a user's own files, from Python and from a recipe."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from skimage.io import imread

FOLDER = Path(__file__).parents[2] / "examples" / "own_parts"


def test_parts_of_ones_own_fit_coins_from_python_and_from_a_recipe(tmp_path: Path) -> None:
    picture = tmp_path / "out.png"
    command = [sys.executable, "-W", "error", str(FOLDER / "fit.py"), str(picture)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    energies = [float(line.rpartition(" ")[2]) for line in done.stdout.splitlines() if line.startswith("coin ")]
    assert len(energies) == 4
    assert max(energies) < 0.08
    assert imread(picture).std() > 1
