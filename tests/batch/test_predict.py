"""`lightning predict -c recipes/fit_dataset.yaml`: as it is run, killed and gone on with."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from nocs_lookalike import write_frames
from tiny_model import write_tiny

from kfit.training.lightning_cli import main

RECIPE = Path(__file__).parents[2] / "recipes/fit_dataset.yaml"
PHOTOS = ("--data", "kfit.batch.photo_folder.PhotoFolder", "--data.category", "mug")
NUM_FRAMES = 8
TWO = ("--trainer.strategy", "ddp", "--trainer.devices", "2")


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with frames of mugs in ``nocs``, and a tiny model of them."""
    place = tmp_path_factory.mktemp("place")
    write_frames(place / "nocs", [("mug", "mug")] * NUM_FRAMES)
    write_tiny(place / "mug.safetensors")
    return place


def words(place, out, *more):
    return [
        "predict", "-c", str(RECIPE), "--data.root", str(place / "nocs"), "--data.split", "real_test",
        "--model.models", json.dumps({"mug": str(place / "mug.safetensors")}), "--model.out", str(out),
        "--model.num_starts", "4", "--model.num_steps", "20", "--trainer.accelerator", "cpu", *more,
    ]  # fmt: skip


def start(place, out, *more):
    return subprocess.Popen(
        [sys.executable, "-m", "kfit", *words(place, out, *more)], cwd=place, start_new_session=True,
        env={**os.environ, "OMP_NUM_THREADS": "1"}, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True,
    )  # fmt: skip


def results(out):
    return {path.name: path.read_bytes() for path in out.glob("results_*.pkl")}


@pytest.fixture(scope="module")
def uninterrupted(place):
    """Results of one process that nobody disturbed."""
    process = start(place, place / "whole")
    errors = process.communicate()[1]
    assert process.returncode == 0, errors
    assert f"{2 * NUM_FRAMES} objects in {NUM_FRAMES} images fitted" in errors
    assert not (place / "config.yaml").exists()
    whole = results(place / "whole")
    assert len(whole) == NUM_FRAMES
    return whole


@pytest.mark.slow
@pytest.mark.parametrize("more", [(), TWO], ids=["one process", "two processes"])
def test_a_killed_run_goes_on_and_ends_with_the_results_of_one_that_was_not(place, uninterrupted, more, tmp_path):
    out = tmp_path / "out"
    first = start(place, out, *more)
    while len(results(out)) < 2:
        assert first.poll() is None, first.communicate()[1]
        time.sleep(0.02)
    os.killpg(first.pid, signal.SIGKILL)
    first.communicate()
    done = {path: path.stat().st_mtime_ns for path in out.glob("results_*.pkl")}
    assert 2 <= len(done) < NUM_FRAMES
    again = start(place, out, *more)
    errors = again.communicate()[1]
    assert again.returncode == 0, errors
    assert f"{NUM_FRAMES - len(done)} of {NUM_FRAMES} images are to be fitted" in errors
    if more:
        assert "process 1 of 2: " in errors
        assert "process 2 of 2: " in errors
    assert {path: path.stat().st_mtime_ns for path in done} == done
    assert results(out) == uninterrupted
    assert {path.name for path in out.iterdir()} == {*uninterrupted, "fit.json"}


@pytest.mark.slow
def test_two_processes_tell_a_mistake_once(place, tmp_path):
    process = start(place, tmp_path / "out", "--data.split", "real_train", *TWO)
    errors = process.communicate()[1]
    assert process.returncode == 2, errors
    assert errors.count("kfit: root must hold real/train or") == 1
    assert "Traceback" not in errors


@pytest.mark.slow
def test_two_processes_can_share_one_image(place, uninterrupted, tmp_path):
    last = sorted(uninterrupted)[-1]
    out = tmp_path / "out"
    out.mkdir()
    (out / "fit.json").write_text((place / "whole/fit.json").read_text())
    for name in set(uninterrupted) - {last}:
        (out / name).write_bytes(b"")
    process = start(place, out, *TWO)
    errors = process.communicate()[1]
    assert process.returncode == 0, errors
    assert (out / last).read_bytes() == uninterrupted[last]


@pytest.mark.parametrize(
    ("more", "sentence"),
    [
        (("--data.root", "nowhere"), "kfit: root must hold real/test or Real/test or real_test, but nowhere does not"),
        ((*PHOTOS, "--data.root", "nowhere"), "kfit: there is no folder nowhere"),
        (("--model.models", '{"cup": "cup.safetensors"}'), "kfit: models: unknown cup; the names are bottle"),
    ],
)
@pytest.mark.filterwarnings("ignore:.*args parameter is intended", "ignore:.*LeafSpec", "ignore:.*num_workers")
def test_a_mistake_gets_a_sentence(place, tmp_path, monkeypatch, capsys, more, sentence):
    monkeypatch.setattr("sys.argv", ["lightning"])
    monkeypatch.setenv("JSONARGPARSE_DEPRECATION_WARNINGS", "off")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit, match="2"):
        main(words(place, tmp_path / "out", *more))
    assert sentence in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
