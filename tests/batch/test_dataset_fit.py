"""Data sets fitted image by image, in runs that may be interrupted."""

from __future__ import annotations

import json
import warnings
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from lightning import Trainer
from model_file import card_of, put_card
from nocs_lookalike import SHAPE, write_frames

from kfit.batch.dataset_fit import DatasetFit
from kfit.batch.fit_data import ObjectCropper
from kfit.batch.nocs_fit import NOCSFit
from kfit.batch.photo_folder import PhotoFolder
from kfit.data import dump_pickle, load_pickle, read_results, result_files
from kfit.geometry import CATEGORIES
from kfit.metrics import evaluate_nocs
from kfit.models import load, write_model
from kfit.pose import CategoryModel

SCENES = [("mug", "camera", "mug"), (), ("bowl", "mug"), ("mug",)]


@pytest.fixture
def models(tiny_model: CategoryModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Path]:
    """Files of tiny models of bowls and mugs, the only ones that there are."""
    monkeypatch.setattr("kfit.batch.dataset_fit.bundled", lambda: [])
    parts = {"generator": tiny_model.generator, "encoder": tiny_model.encoder, "extents": tiny_model.extents}
    files = {name: tmp_path / f"{name}.safetensors" for name in ("bowl", "mug")}
    for name, path in files.items():
        write_model(path, parts, replace(tiny_model.card, category=name))
    return files


@pytest.fixture
def nocs(tmp_path: Path) -> Path:
    write_frames(tmp_path / "nocs", SCENES)
    return tmp_path / "nocs"


def fit(data, out, models, **settings):
    """One run in this process."""
    module = DatasetFit(out, models, num_starts=3, num_steps=2, **settings)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*LeafSpec.*")
        trainer = Trainer(
            accelerator="cpu", devices=1, logger=False, enable_checkpointing=False, enable_model_summary=False,
            enable_progress_bar=False, default_root_dir=out,
        )  # fmt: skip
        trainer.predict(module, datamodule=data, return_predictions=False)
    return module


def contents(out):
    return {path.name: path.read_bytes() for path in out.iterdir()}


def test_each_frame_gets_a_result_that_can_be_evaluated(nocs, models, tmp_path, caplog):
    caplog.set_level("INFO", "kfit")
    module = fit(NOCSFit(nocs, "real_test"), tmp_path / "out", models)
    files = result_files(tmp_path / "out")
    assert [path.name for path in files] == [
        "results_test_scene_1_0000.pkl", "results_test_scene_1_0002.pkl",
        "results_test_scene_2_0001.pkl", "results_test_scene_2_0003.pkl",
    ]  # fmt: skip
    results = list(read_results(files))
    assert [result["pred_class_ids"].tolist() for result in results] == [[6, 6], [2, 6], [], [6]]
    assert [result["gt_class_ids"].tolist() for result in results] == [[6, 3, 6], [2, 6], [], [6]]
    np.testing.assert_array_equal(results[1]["pred_bboxes"], results[1]["gt_bboxes"])
    assert results[0]["unfitted"] == ["camera: there is no model of the category"]
    np.testing.assert_allclose(np.linalg.norm(results[3]["pred_scales"], axis=1), 1, rtol=1e-6)
    assert (results[3]["pred_RTs"][:, 2, 3] > 0).all()
    assert evaluate_nocs(results).num_truths.tolist() == [0, 1, 1, 0, 0, 4]
    assert module.counts["objects"] == 5
    logged = caplog.text
    assert "4 of 4 images are to be fitted" in logged
    assert "5 objects in 4 images fitted into" in logged
    assert "1 camera not, for there is no model" in logged


@pytest.mark.slow
def test_a_run_goes_on_where_another_stopped_and_ends_with_the_same_results(nocs, models, tmp_path, caplog):
    caplog.set_level("INFO", "kfit")
    out = tmp_path / "out"
    fit(NOCSFit(nocs, "real_test"), out, models)
    whole = contents(out)
    for name in ("results_test_scene_1_0000.pkl", "results_test_scene_2_0003.pkl"):
        (out / name).unlink()
    kept = (out / "results_test_scene_1_0002.pkl").stat().st_mtime_ns
    assert fit(NOCSFit(nocs, "real_test"), out, models).counts["images"] == 2
    assert contents(out) == whole
    assert (out / "results_test_scene_1_0002.pkl").stat().st_mtime_ns == kept
    caplog.clear()
    assert fit(NOCSFit(nocs, "real_test"), out, models).counts["images"] == 0
    assert "0 of 4 images are to be fitted" in caplog.text
    assert contents(out) == whole


@pytest.mark.slow
def test_the_number_of_threads_changes_nothing(nocs, models, tmp_path):
    before = torch.get_num_threads()
    try:
        for count in (1, 3):
            torch.set_num_threads(count)
            fit(NOCSFit(nocs, "real_test"), tmp_path / f"out{count}", models)
            assert torch.get_num_threads() == count
    finally:
        torch.set_num_threads(before)
    assert contents(tmp_path / "out1") == contents(tmp_path / "out3")


@pytest.mark.slow
def test_a_run_that_breaks_off_gives_pytorch_its_threads_back(nocs, models, tmp_path, monkeypatch):
    def broken(*_):
        assert torch.get_num_threads() == 1
        raise ZeroDivisionError

    monkeypatch.setattr("kfit.pose.category_model.CategoryModel.answers", broken)
    before = torch.get_num_threads()
    try:
        torch.set_num_threads(3)
        with pytest.raises(ZeroDivisionError):
            fit(NOCSFit(nocs, "real_test"), tmp_path / "out", models)
        assert torch.get_num_threads() == 3
    finally:
        torch.set_num_threads(before)


def test_other_settings_and_other_models_are_refused(nocs, models, tmp_path):
    out = tmp_path / "out"
    fit(NOCSFit(nocs, "real_test"), out, models)
    with pytest.raises(ValueError, match="holds results of other settings, seed 0 there and 1 now"):
        fit(NOCSFit(nocs, "real_test"), out, models, seed=1)
    put_card(models["mug"], card_of(models["mug"]) | {"axes": "y is up"})
    with pytest.raises(ValueError, match=r"model of mug \w+ there and \w+ now"):
        fit(NOCSFit(nocs, "real_test"), out, models)


@pytest.mark.slow
def test_an_object_s_result_is_the_same_in_a_larger_batch_to_rounding(nocs, models, tmp_path):
    for size in (1, 4):
        fit(NOCSFit(nocs, "real_test", batch_size=size), tmp_path / f"out{size}", models)
    for alone, together in zip(*(read_results(result_files(tmp_path / f"out{size}")) for size in (1, 4)), strict=True):
        np.testing.assert_allclose(alone["pred_RTs"], together["pred_RTs"], atol=1e-4)


def test_two_objects_of_an_image_start_from_other_random_numbers(nocs):
    first, _, second = NOCSFit(nocs, "real_test").read("results_test_scene_1_0000.pkl").objects
    (alone,) = NOCSFit(nocs, "real_test").read("results_test_scene_2_0003.pkl").objects
    assert len({first.key, second.key, alone.key}) == 3
    # The same on every machine: of `printf results_test_scene_1_0000.pkl/1 | sha256sum` the first 16 digits.
    assert first.key == 0xCBF0BA0BD62F580A


def test_detections_tell_objects_masks_and_scores(nocs, models, tmp_path):
    found = tmp_path / "detections"
    found.mkdir()
    masks = np.zeros((*SHAPE, 2), np.uint8)
    masks[10:30, 12:40, 0] = masks[5:20, 50:70, 1] = 1
    boxes = np.array([[10, 12, 30, 40], [5, 50, 20, 70]])
    saved = {"pred_bboxes": boxes, "pred_class_ids": np.array([6, 2]), "pred_scores": np.array([0.75, 0.5])}
    dump_pickle(found / "results_real_test_scene_1_0000.pkl", saved | {"pred_masks": masks})
    nothing = {"rois": np.zeros((0, 4)), "class_ids": np.zeros(0), "scores": np.zeros(0), "masks": np.zeros((0, 0, 0))}
    for name in ("results_test_scene_1_0002.pkl", "results_real_test_scene_2_0001.pkl"):
        dump_pickle(found / name, nothing)
    with pytest.warns(UserWarning, match=r"there will be no results_test_scene_2_0003.pkl: .* has no detections for"):
        module = fit(NOCSFit(nocs, "real_test", found), tmp_path / "out", models)
    assert module.counts["unreadable"] == 1
    result = load_pickle(tmp_path / "out/results_test_scene_1_0000.pkl")
    np.testing.assert_array_equal(result["pred_bboxes"], boxes)
    assert result["pred_scores"].tolist() == [0.75, 0.5]
    assert result["pred_class_ids"].tolist() == [6, 2]
    assert result["gt_class_ids"].tolist() == [6, 3, 6]
    assert len(result_files(tmp_path / "out")) == 3


def test_an_object_that_cannot_be_fitted_is_reported_and_the_others_are_fitted(nocs, models, tmp_path):
    found = tmp_path / "detections"
    found.mkdir()
    masks = np.zeros((*SHAPE, 2), np.uint8)
    masks[10:30, 12:40, 0] = 1
    saved = {
        "pred_bboxes": np.array([[10, 12, 30, 40], [5, 50, 20, 70]]), "pred_class_ids": np.array([6, 6]),
        "pred_scores": np.array([0.75, 0.5]), "pred_masks": masks,
    }  # fmt: skip
    for path in (nocs / "gts/real_test").iterdir():
        dump_pickle(found / path.name, saved)
    with pytest.warns(UserWarning, match=r"a mug of results_test_scene_\w+.pkl is not fitted: mask is empty") as warned:
        module = fit(NOCSFit(nocs, "real_test", found), tmp_path / "out", models)
    assert (module.counts["objects"], module.counts["unfitted"], len(warned)) == (4, 4, 4)
    result = load_pickle(tmp_path / "out/results_test_scene_1_0000.pkl")
    assert len(result["pred_RTs"]) == 1
    assert result["unfitted"] == ["mug: mask is empty: none of its pixels is above one half"]


@pytest.mark.slow
def test_a_damaged_frame_does_not_end_the_run(nocs, models, tmp_path):
    (nocs / "real/test/scene_1/0002_depth.png").write_bytes(b"no picture")
    with pytest.warns(UserWarning, match=r"no results_test_scene_1_0002.pkl: .*0002_depth.png is not an image"):
        fit(NOCSFit(nocs, "real_test"), tmp_path / "out", models)
    assert len(result_files(tmp_path / "out")) == 3


def test_wrong_arguments_get_a_sentence(nocs, models, tmp_path):
    out = tmp_path / "out"
    with pytest.raises(ValueError, match="models: unknown cup; the names are bottle, "):
        fit(NOCSFit(nocs, "real_test"), out, {"cup": Path("cup.safetensors")})
    with pytest.raises(FileNotFoundError, match="root must hold real/train or"):
        fit(NOCSFit(nocs, "real_train"), out, models)
    with pytest.raises(FileNotFoundError, match=r"detections must be a folder of results_\*.pkl"):
        fit(NOCSFit(nocs, "real_test", tmp_path / "nowhere"), out, models)
    with pytest.raises(FileNotFoundError, match="no model at"):
        fit(NOCSFit(nocs, "real_test"), out, {**models, "mug": tmp_path / "none.safetensors"})
    with pytest.raises(ValueError, match=r"bowl.safetensors is of the category bowl"):
        fit(NOCSFit(nocs, "real_test"), out, {**models, "mug": models["bowl"]})
    with pytest.raises(
        ValueError, match=r"there is no model that draws depth of bottle, bowl, .*; there are models of bowl, mug"
    ):
        fit(NOCSFit(nocs, "real_test"), out, models, depth=True)
    with pytest.raises(FileNotFoundError, match="there is no folder"):
        fit(PhotoFolder(tmp_path / "nowhere", "mug"), out, models)
    (tmp_path / "empty").mkdir()
    with pytest.raises(FileNotFoundError, match="empty holds no photos"):
        fit(PhotoFolder(tmp_path / "empty", "mug"), out, models)
    with pytest.raises(ValueError, match="there is no model of cup; there are models of bowl, mug"):
        fit(PhotoFolder(tmp_path, "cup"), out, models)
    assert not out.exists()


def write_photo(path: Path, mask: bool) -> None:
    assert cv2.imwrite(str(path), np.random.default_rng(0).integers(0, 255, (40, 50, 3), np.uint8))
    if mask:
        assert cv2.imwrite(str(path.with_name(f"{path.stem}_mask.png")), np.full((40, 50), 255, np.uint8))


def test_each_photo_with_a_mask_gets_the_answer_that_it_gets_alone(models, tmp_path):
    photos, out = tmp_path / "photos", tmp_path / "poses"
    photos.mkdir()
    write_photo(photos / "cup.png", mask=True)
    write_photo(photos / "bare.jpg", mask=False)
    (photos / "damaged.png").write_bytes(b"no picture")
    with pytest.warns(UserWarning, match="there will be no") as warned:
        module = fit(PhotoFolder(photos, "mug"), out, models)
    messages = "\n".join(str(warning.message) for warning in warned)
    assert "there will be no damaged.json: " in messages
    assert "there will be no bare.json: no mask of the object: neither" in messages
    assert (module.counts["images"], module.counts["unreadable"]) == (1, 2)
    assert set(contents(out)) == {"cup.json", "fit.json"}
    model, threads = load(models["mug"]), torch.get_num_threads()
    torch.set_num_threads(1)  # as data sets are fitted; more change the rounding
    try:
        alone = model.pose(photos / "cup.png", mask=np.ones((40, 50)), pipeline=model.pipeline(3, 2))
    finally:
        torch.set_num_threads(threads)
    assert json.loads((out / "cup.json").read_text()) == json.loads(json.dumps(alone.to_dict()))


def test_two_photos_of_one_name_are_refused(models, tmp_path):
    write_photo(tmp_path / "cup.png", mask=True)
    write_photo(tmp_path / "cup.jpg", mask=False)
    with pytest.raises(ValueError, match=r"cup.jpg and .*cup.png would both have their result in cup.json"):
        fit(PhotoFolder(tmp_path, "mug"), tmp_path / "out", models)


@pytest.mark.parametrize("world_size", [1, 2, 3, 5])
def test_processes_share_the_images_without_repeating_any(nocs, world_size, monkeypatch):
    data = NOCSFit(nocs, "real_test")
    data.left = data.names()
    shares = []
    for rank in range(world_size):
        data.trainer = type("Trainer", (), {"global_rank": rank, "world_size": world_size})()
        shares += [image.name for batch in data.predict_dataloader() for image in batch]
    assert sorted(shares) == data.left


def test_processes_that_read_cut_the_same_out(nocs):
    data = NOCSFit(nocs, "real_test", batch_size=3)
    data.left, data.cropper = data.names(), ObjectCropper({"mug": (CATEGORIES["mug"], 64)}, depth=False)
    found = []
    for data.num_workers in (0, 2):
        found.append([image for batch in data.predict_dataloader() for image in batch])
    assert [image.name for image in found[0]] == data.left
    for here, there in zip(*found, strict=True):
        assert len(here.observed) == len(there.observed) == len(here.objects)
        for one, other in zip(here.observed, there.observed, strict=True):
            if isinstance(one, str):
                assert one == other == "there is no model of the category"
            else:
                assert torch.equal(one.observation.image, other.observation.image)


def test_the_depth_file_of_a_real_photo_is_used(dev_data, tmp_path):
    photos = tmp_path / "photos"
    photos.mkdir()
    for part, name in (("image", "mug.png"), ("mask", "mug_mask.png"), ("depth", "mug_depth.png")):
        (photos / name).write_bytes((dev_data / f"photos/mug_d435_{part}.png").read_bytes())
    with torch.random.fork_rng():
        fit(PhotoFolder(photos, "mug"), tmp_path / "out", None, depth=True)
    assert json.loads((tmp_path / "out/mug.json").read_text())["size_from"] == "depth"
