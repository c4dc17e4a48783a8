"""Data sets with known poses as data sets to fit, on lookalikes with one mug."""

import json

import numpy as np
import pytest
from lookalikes import depth_of, mask_of, mug, write_bop, write_objectron, write_wild6d

from kfit.batch.annotated_fit import AnnotatedFit
from kfit.cli.main import main
from kfit.data.bop import BOPFrames
from kfit.data.objectron import ObjectronFrames
from kfit.data.wild6d import Wild6DFrames


def test_a_frame_is_read_with_its_mask_depth_and_camera(tmp_path):
    write_bop(tmp_path)
    data = AnnotatedFit(BOPFrames(str(tmp_path), {14: "mug"}))
    assert data.names() == ["000001_000003.csv"]
    assert data.categories == ("mug",)
    image = data.read("000001_000003.csv")
    view, *_ = mug()
    (thing,) = image.objects
    np.testing.assert_array_equal(thing.mask, mask_of(view) > 0)
    np.testing.assert_allclose(image.depth, depth_of(view) / 1000, atol=1e-3)


def test_a_data_set_without_masks_has_the_object_cut_out_of_its_box(tmp_path):
    write_objectron(tmp_path)
    data = AnnotatedFit(ObjectronFrames(str(tmp_path / "annotation.pbdata"), str(tmp_path / "images")))
    (thing,) = data.read(data.names()[0]).objects
    truth = mask_of(mug()[0]) > 0
    found = np.asarray(thing.mask) > 0.5
    assert (found & truth).sum() / (found | truth).sum() > 0.7


@pytest.mark.slow
def test_wild6d_is_fitted_and_scored_by_two_commands(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["lightning"])
    monkeypatch.setenv("JSONARGPARSE_DEPRECATION_WARNINGS", "off")
    write_wild6d(tmp_path / "set")
    frames = Wild6DFrames(str(tmp_path / "set"), "mug")
    assert frames[0].objects[0].pose[0, 3] == pytest.approx(mug()[2][0])
    source = ["--data.source", "kfit.data.wild6d.Wild6DFrames", "--data.source.root", "set"]
    main(
        [
            *("predict", "--trainer.logger", "false", "--trainer.enable_checkpointing", "false"),
            *("--trainer.accelerator", "cpu", "--model", "kfit.batch.dataset_fit.DatasetFit", "--model.out", "out"),
            *("--data", "kfit.batch.annotated_fit.AnnotatedFit", *source, "--data.source.category", "mug"),
        ]
    )
    main(["evaluate", "out", "--scale-agnostic", "--out", "scores"])
    scores = json.loads((tmp_path / "scores" / "scores.json").read_text())
    assert "mug" in json.dumps(scores)
    assert "100" in capsys.readouterr().out
