"""Every example runs as a reader runs it, ends in a picture that is worth showing, and keeps what it promises."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from skimage.io import imread

from kfit import load

EXAMPLES = Path(__file__).parents[2] / "examples"
SCRIPTS = sorted(path for path in EXAMPLES.rglob("*.py") if not path.name.startswith("_"))


def run(script: str, folder: Path, *words: str) -> str:
    """What an example prints before its last line, which must name its picture."""
    command = [sys.executable, "-W", "error", str(EXAMPLES / script), "made/here", *words]
    done = subprocess.run(command, capture_output=True, text=True, cwd=folder)
    assert done.returncode == 0, done.stderr
    *lines, last = done.stdout.splitlines()
    assert Path(last).parent == Path("made/here")
    picture = imread(folder / last)
    height, width = picture.shape[:2]
    assert 200 < height < 2400
    assert 600 < width < 2400
    assert picture[..., :3].std() > 20
    return "\n".join(lines)


def numbers(pattern: str, printed: str) -> list[float]:
    return [float(number) for number in re.findall(pattern, printed)]


def test_examples_are_short_and_say_how_they_are_run() -> None:
    assert len(SCRIPTS) > 8
    for path in SCRIPTS:
        text = path.read_text()
        assert len(text.splitlines()) < 60, path
        if "sys.argv" in text:
            assert f"python {path.relative_to(EXAMPLES.parent)} " in text, path


@pytest.mark.slow
def test_a_fit_composed_by_hand_finds_most_unseen_laptops(tmp_path: Path) -> None:
    errors = numbers(r"([\d.]+)°", run("compose_a_fit.py", tmp_path))
    assert len(errors) == 3
    assert sorted(errors)[1] < 10  # the wrong side of a laptop may win now and then


def test_two_photos_are_registered_to_a_fraction_of_a_pixel(tmp_path: Path) -> None:
    printed = run("register_photos.py", tmp_path)
    assert numbers(r"off by ([\d.]+) pixels", printed)[0] < 0.1
    assert numbers(r"gain ([\d.]+)", printed)[0] == pytest.approx(0.8, abs=0.005)


@pytest.mark.slow
def test_the_pose_of_a_known_mesh_is_found_in_clutter_from_forty_degrees_away(tmp_path: Path) -> None:
    before, after = numbers(r"off by ([\d.]+)°", run("fit_known_mesh.py", tmp_path))
    assert after < 5 < 39 < before


@pytest.mark.slow
def test_two_views_find_the_pose_of_a_mesh_from_forty_degrees_away(tmp_path: Path) -> None:
    printed = run("fit_two_views.py", tmp_path)
    assert numbers(r"off by ([\d.]+)°", printed)[0] < 3
    assert numbers(r"by ([\d.]+) mm", printed)[0] < 10


@pytest.mark.slow
def test_a_second_photo_tells_how_large_and_how_far_away_a_mug_is(tmp_path: Path) -> None:
    one, two = numbers(r"off by ([\d.]+) cm", run("pose_two_photos.py", tmp_path))
    assert two < 5 < 10 < one


@pytest.mark.slow
def test_a_bent_picture_is_straightened(tmp_path: Path) -> None:
    printed = run("bend_a_picture.py", tmp_path)
    before, after = numbers(r"by ([\d.]+) (?:before|after)", printed)
    assert after < 0.3 * before


@pytest.mark.slow
def test_an_optimizer_of_torch_s_inverts_a_generator(tmp_path: Path) -> None:
    mean, found = numbers(r"([\d.]+) for", run("invert_a_generator.py", tmp_path))
    assert found < 0.8 * mean


@pytest.mark.slow
def test_a_fitted_object_becomes_a_closed_mesh_of_its_size(tmp_path: Path) -> None:
    printed = run("mesh_of_an_object.py", tmp_path)
    assert "closed: True" in printed
    extents, box = (numbers(r"([\d.]+)", part) for part in printed.split(";")[1].split("in a fitted box of"))
    assert extents == pytest.approx(box, rel=0.2)
    assert (tmp_path / "made/here/mug.glb").stat().st_size > 10_000


def test_an_energy_of_ones_own_named_in_a_recipe_bears_what_l1_does_not(tmp_path: Path) -> None:
    plain, own = numbers(r"off by ([\d.]+) pixels", run("own_parts/fit.py", tmp_path))
    assert own < 1.5 < plain


@pytest.mark.slow
def test_a_swapped_code_brings_its_colour_along(tmp_path: Path) -> None:
    before, after = numbers(r"by ([\d.]+)", run("edit_appearance.py", tmp_path))
    assert after < before / 2


def denoised(printed: str) -> list[tuple[float, float]]:
    """PSNR and SSIM of the noisy picture, by L1 alone and by kfit's energies."""
    return list(zip(numbers(r"PSNR ([\d.]+)", printed), numbers(r"SSIM ([\d.]+)", printed), strict=True))


@pytest.mark.slow
def test_structure_and_features_keep_more_structure_than_l1_alone(tmp_path: Path) -> None:
    noisy, plain, more = denoised(run("train_denoiser.py", tmp_path))
    assert more[1] > plain[1] + 0.005
    assert min(plain[0], more[0]) > noisy[0] + 8
    assert min(plain[1], more[1]) > noisy[1] + 0.05


@pytest.mark.slow
def test_depth_tells_how_far_away_a_small_mug_is(tmp_path: Path) -> None:
    colour, depth = numbers(r"off by ([\d.]+) cm", run("pose_with_depth.py", tmp_path))
    assert depth < 1 < 10 < colour


@pytest.mark.slow
def test_two_processes_fit_a_folder_and_another_run_finds_it_done(tmp_path: Path) -> None:
    for _ in range(2):
        run("fit_a_folder.py", tmp_path)
        poses = {path.name: json.loads(path.read_text()) for path in tmp_path.glob("made/here/poses/mug*.json")}
        assert sorted(poses) == [f"mug{number}.json" for number in range(6)]
        assert {pose["intrinsics_from"] for pose in poses.values()} == {"EXIF"}


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
