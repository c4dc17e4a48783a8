from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from skimage.io import imread

from kfit import load

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.mark.parametrize("script", sorted(path.name for path in EXAMPLES.glob("*.py") if path.name != "train_all.py"))
def test_an_example_runs_and_ends_in_a_picture(script: str, tmp_path: Path) -> None:
    picture = tmp_path / "out.png"
    command = [sys.executable, "-W", "error", str(EXAMPLES / script), str(picture)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert imread(picture).std() > 1


@pytest.mark.slow
def test_training_all_goes_on_where_it_was_stopped_and_packs_each_model_once(tmp_path: Path) -> None:
    words = (
        "--data.num_objects 8 --data.num_val_objects 2 --data.num_views 4 --data.batch_size 4 --trainer.max_epochs 1 "
        "--trainer.limit_train_batches 1 --trainer.limit_val_batches 1 --model.compile false --data.cache_dir"
    )
    command = [sys.executable, str(EXAMPLES / "train_all.py"), "runs", "can", *words.split(), str(tmp_path / "cache")]
    model = tmp_path / "runs" / "can.safetensors"
    for _ in range(2):
        done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        packed = load(str(model))
        assert packed.pose_head is not None
        assert packed.card.training["command"].count(f"--data.category can {words}") == 2
        checkpoints = list(tmp_path.glob("runs/can/*/lightning_logs/version_*/checkpoints/last.ckpt"))
        model.unlink()  # as if it had been stopped before packing
    assert {path.parts[-5] for path in checkpoints} == {"generator", "pose_head"}
