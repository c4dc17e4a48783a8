"""The how-to for a category of one's own, from ten mesh files to a pose in a photo, at a tiny size."""

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh
from skimage.io import imsave

import kfit
from kfit.cli.main import main
from kfit.data import Light, pose_view
from kfit.data.mesh_places import find_mesh_files
from kfit.models import read_card

RECIPES = Path(__file__).parents[1] / "recipes"
TINY = [
    "--trainer.max_epochs",
    "1",
    "--trainer.accelerator",
    "cpu",
    "--trainer.log_every_n_steps",
    "1",
    "--trainer.precision",
    "32",
    "--model.compile",
    "false",
]
DATA = ["--data.num_objects", "9", "--data.num_views", "4", "--data.num_val_objects", "2", "--data.batch_size", "8"]


def write_teapots(folder):
    """Ten pots with z up and the spout towards −y, in four formats."""
    folder.mkdir()
    rng = np.random.default_rng(0)
    for number in range(10):
        pot = trimesh.creation.cylinder(rng.uniform(0.3, 0.5), rng.uniform(0.5, 0.9), sections=16)
        spout = trimesh.creation.box((0.1, 0.5, 0.1)).apply_translation((0, -0.5, 0.1))
        mesh = trimesh.util.concatenate([pot, spout])
        mesh.visual.vertex_colors = np.tile(np.r_[rng.integers(60, 255, 3), 255], (len(mesh.vertices), 1))
        mesh.export(folder / f"teapot{number}.{('ply', 'stl', 'glb', 'obj')[number % 4]}")


@pytest.mark.slow
def test_ten_meshes_become_a_model_that_poses_packs_and_calibrates(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["kfit"])
    monkeypatch.setenv("JSONARGPARSE_DEPRECATION_WARNINGS", "off")
    write_teapots(tmp_path / "teapots")
    (tmp_path / "teapot.yaml").write_text("name: teapot\nmean_diagonal: 0.28\naxes: y up, spout towards +x\n")
    own = ["--data.category", "teapot.yaml", "--data.meshes", "teapots@z,-y", *DATA, *TINY]
    main(["views", "--category", "teapot.yaml", "--meshes", "teapots@z,-y", "--show", "sheet.png", "--objects", "3"])
    for recipe in ("radiance_field", "pose_head"):
        main(["fit", "-c", str(RECIPES / f"{recipe}.yaml"), *own])
    last = "lightning_logs/version_{}/checkpoints/last.ckpt"
    (tmp_path / "teapot.yaml").unlink()  # the card tells all
    main(["pack", last.format(0), "--pose-head", last.format(1), "--out", "teapot.safetensors"])
    card = read_card("teapot.safetensors")
    assert (card.category, card.known.name, card.mean_diagonal) == ("teapot", "teapot", 0.28)
    mesh = find_mesh_files("teapots/teapot0.ply@z,-y")[0].mesh()
    view = pose_view(mesh, 0.5, 0.3, Light.random(np.random.default_rng(0)), 128)
    imsave("photo.png", (255 * view.image).astype(np.uint8), check_contrast=False)
    imsave("mask.png", (255 * view.mask).astype(np.uint8), check_contrast=False)
    main(["pose", "photo.png", "--mask", "mask.png", "--model", "teapot.safetensors"])
    answer = json.loads((tmp_path / "kfit_out" / "pose.json").read_text())
    assert (answer["category"], answer["symmetry"], answer["category_score"]) == ("teapot", "none", None)
    places = ["--model", "teapot.safetensors", "--meshes", '["teapots@z,-y"]']
    main(["calibrate", *places, "--views", "14"])
    assert "RGB" in read_card("teapot.safetensors").calibration
    some = [*places[:3], '["teapots/teapot0.ply@z,-y", "teapots/teapot3.obj@z,-y"]']
    main(["bench", "accuracy", *some, "--scan-views", "1", "--card"])
    assert "scans, upright views" in read_card("teapot.safetensors").accuracy
    main(["export", "teapot.safetensors", "--out", "onnx"])
    (tmp_path / "frames").mkdir()
    for number in range(2):
        (tmp_path / "frames" / f"{number}.png").write_bytes((tmp_path / "photo.png").read_bytes())
    main(["video", "frames", "--model", "teapot.safetensors", "--mask", "mask.png"])
    assert kfit.load("teapot.safetensors").card.known.axes == "y up, spout towards +x"
