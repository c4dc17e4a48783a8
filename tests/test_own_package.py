"""A package outside of kfit, with a category of its own: train, pack, pose, share, and use without the package."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[1]
TEAPOTS = """
import numpy as np
from kfit.data import Mesh, join
from kfit.data.shapes import colors, textures
from kfit.data.shapes.placing import shift
from kfit.data.shapes.primitives import revolve
from kfit.geometry import Category

TEAPOT = Category("teapot", 0.28, axes="y up, spout towards +x", front="spout", shapes="teapots.objects")


def build(rng: np.random.Generator, held_out: bool) -> Mesh:
    height, tile = rng.uniform(1.0, 1.3) if held_out else rng.uniform(0.6, 0.9), textures.solid(colors.any_color(rng))
    pot = revolve(np.array([(0.0, -height / 2), (0.5, -height / 2), (0.4, height / 2), (0.0, height / 2)]), tile, 24)
    spout = revolve(np.array([(0.08, 0.0), (0.05, 0.3)]), tile, 12).transformed(shift(0.5, 0.0, 0.0))
    return join([pot, spout])
"""
TINY = [
    *("--trainer.max_epochs", "1", "--trainer.accelerator", "cpu", "--trainer.precision", "32"),
    *("--trainer.limit_train_batches", "2", "--trainer.limit_val_batches", "1", "--trainer.log_every_n_steps", "1"),
    *("--data.num_objects", "4", "--data.num_views", "4", "--data.num_val_objects", "2", "--data.batch_size", "4"),
]
NETWORKS = [
    *("--model.generator.volume_dims", "[8,8,4]", "--model.generator.projection_dim", "8"),
    *("--model.generator.decoder_dims", "[8,8]", "--model.encoder.channels", "[8,8,8,8]"),
]
PHOTO = """
import numpy as np
from skimage.io import imsave
from kfit.data import build, pose_view
from teapots.objects import TEAPOT

mesh, light = build(TEAPOT, 3, held_out=True)
view = pose_view(mesh, 0.5, 0.3, light, 128)
imsave("photo.png", (255 * view.image).astype(np.uint8), check_contrast=False)
imsave("mask.png", (255 * view.mask).astype(np.uint8), check_contrast=False)
"""
SHARE = """
from pathlib import Path
import kfit

print(kfit.load("teapot.safetensors").push_to_hub(Path("shared")))
"""
USE = """
from importlib.util import find_spec
from skimage.io import imread
from kfit.pose import CategoryModel

assert find_spec("teapots") is None
model = CategoryModel.from_pretrained("shared")
print(model.pose("photo.png", mask=imread("mask.png")).to_dict()["category"], model.card.known.front)
"""


class Machine:
    """A folder in which commands run, and what Python finds there."""

    def __init__(self, folder: Path, *packages: Path) -> None:
        folder.mkdir()
        paths = os.pathsep.join(map(str, (ROOT, *packages)))
        self.folder, self.env = folder, os.environ | {"PYTHONPATH": paths, "OMP_NUM_THREADS": "1"}

    def run(self, *words: str) -> subprocess.CompletedProcess:
        return subprocess.run(
            [sys.executable, *words], cwd=self.folder, env=self.env, capture_output=True, text=True, timeout=900
        )

    def __call__(self, *words: str) -> str:
        done = self.run(*words)
        assert done.returncode == 0, done.stderr
        return done.stdout


@pytest.mark.slow
def test_a_category_of_another_package_is_trained_shared_and_used_without_it(tmp_path):
    (tmp_path / "package" / "teapots").mkdir(parents=True)
    (tmp_path / "package" / "teapots" / "__init__.py").write_text("")
    (tmp_path / "package" / "teapots" / "objects.py").write_text(TEAPOTS)
    mine, theirs = Machine(tmp_path / "mine", tmp_path / "package"), Machine(tmp_path / "theirs")
    own = ["--data.category", "teapots.objects.TEAPOT", *TINY]
    for recipe, extra in (("smoke", NETWORKS), ("pose_head", [])):
        mine("-m", "kfit", "fit", "-c", str(ROOT / "recipes" / f"{recipe}.yaml"), *own, *extra)
    last = "lightning_logs/version_{}/checkpoints/last.ckpt"
    mine("-m", "kfit", "pack", last.format(0), "--pose-head", last.format(1), "--out", "teapot.safetensors")
    mine("-c", PHOTO)
    mine("-m", "kfit", "pose", "photo.png", "--mask", "mask.png", "--model", "teapot.safetensors")
    answer = json.loads((mine.folder / "kfit_out" / "pose.json").read_text())
    assert (answer["category"], answer["category_score"]) == ("teapot", None)
    assert mine("-c", SHARE).split() == ["shared"]

    shutil.copytree(mine.folder / "shared", theirs.folder / "shared")
    for name in ("photo.png", "mask.png"):
        shutil.copy(mine.folder / name, theirs.folder / name)
    assert theirs("-c", USE).split() == ["teapot", "spout"]
    model = "shared/model.safetensors"
    theirs("-m", "kfit", "pose", "photo.png", "--mask", "mask.png", "--model", model)
    again = json.loads((theirs.folder / "kfit_out" / "pose.json").read_text())
    assert np.allclose(again["rotation"], answer["rotation"], atol=1e-3)
    refused = theirs.run("-m", "kfit", "calibrate", "--model", model, "--views", "14")
    assert refused.returncode == 2
    assert "drawn by teapots.objects, which is not imported: --import teapots.objects" in refused.stderr
