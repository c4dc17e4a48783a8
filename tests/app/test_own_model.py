"""The page with a model of a category that kfit does not ship: it needs nothing but the model's file."""

import json
import runpy
from types import SimpleNamespace

import numpy as np
import pytest
from tiny_model import TINY

from kfit.app.actions import FOUND, Actions
from kfit.app.session import Session
from kfit.app.sessions import Sessions
from kfit.cli.main import main
from kfit.geometry import Category
from kfit.models import write_model
from kfit.pose import Card

TEAPOT = Category("teapot", 0.28, axes="y up, spout towards +x", front="spout")


@pytest.fixture
def teapot(tiny_model, tmp_path):
    path = tmp_path / "teapot.safetensors"
    write_model(path, tiny_model.networks, Card("teapot", TINY, 4.0, **Card.fields_of(TEAPOT)))
    return path


@pytest.fixture
def visit(teapot, tmp_path, upload, drawn_mug):
    (tmp_path / "own").mkdir()
    visit = Session(tmp_path / "own", {"teapot": str(teapot)})
    visit.take(upload(drawn_mug[..., :3], "pot.png"))
    visit.take_mask(upload(drawn_mug[..., 3], "mask.png"))
    return visit


def refused(words, capsys):
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code == 2
    return capsys.readouterr().err


def test_the_file_alone_answers_and_the_downloads_repeat_the_answer(visit, upload, drawn_mug, monkeypatch):
    *_, result = visit.fit("teapot")
    assert (result.category, result.category_score, result.front) == ("teapot", None, "spout")
    answer = json.loads(visit.write(result)["pose.json"].read_text())
    monkeypatch.chdir(visit.folder)
    upload(drawn_mug[..., :3], "pot.png").rename(visit.folder / "pot.png")
    again = runpy.run_path("repeat.py")["result"].to_dict()
    assert np.allclose(again["rotation"], answer["rotation"], atol=1e-3)
    words = visit.command("teapot")
    assert words == f"kfit pose pot.png --model {visit.models['teapot']} --mask mask.png"
    main([*words.split()[1:], "--out", "again"])
    assert np.allclose(json.loads((visit.folder / "again" / "pose.json").read_text())["rotation"], answer["rotation"])


def test_an_own_category_that_was_chosen_stays_chosen_when_a_box_is_drawn(visit, upload, drawn_mug):
    visit.category = "teapot"
    visit.draw((0.05, 0.05, 0.9, 0.9))
    assert visit.category == "teapot"
    visit.take_mask(upload(drawn_mug[..., 3], "mask.png"))
    assert visit.category == "teapot"
    visit.category = "bowl"  # of kfit's own the likely one is proposed, as before
    visit.take_mask(upload(drawn_mug[..., 3], "mask.png"))
    assert visit.category == visit.target.category == "mug"
    visit.category = "teapot"
    visit.take(upload(drawn_mug[..., :3], "another.png"))
    assert visit.category != "teapot"


def test_a_visitor_reads_that_own_categories_are_not_found_automatically(tmp_path):
    def hint(*categories):
        return Actions(SimpleNamespace(), Sessions(tmp_path, dict.fromkeys(categories, "a.safetensors"))).found

    assert "For teapot or vase, <b>choose it first</b>" in hint("mug", "teapot", "vase")
    assert hint("mug") == hint() == FOUND


def test_two_models_of_one_category_are_refused(teapot, capsys):
    other = teapot.with_name("other.safetensors")
    other.write_bytes(teapot.read_bytes())
    message = refused(["app", "--models", f"[{teapot},{other}]"], capsys)
    assert message == f"kfit: --models must have a category each, but {teapot} and {other} are of the same one\n"


def test_files_that_are_no_models_are_refused_before_the_page_is_there(tmp_path, capsys):
    assert "--models must name .safetensors files, got mug" in refused(["app", "--models", "mug"], capsys)
    assert "no model at none.safetensors" in refused(["app", "--models", "none.safetensors"], capsys)
