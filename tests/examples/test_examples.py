from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from skimage.io import imread

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.mark.parametrize("script", sorted(path.name for path in EXAMPLES.glob("*.py")))
def test_an_example_runs_and_ends_in_a_picture(script: str, tmp_path: Path) -> None:
    picture = tmp_path / "out.png"
    command = [sys.executable, "-W", "error", str(EXAMPLES / script), str(picture)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert imread(picture).std() > 1
