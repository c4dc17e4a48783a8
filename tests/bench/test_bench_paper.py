import math
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import yaml

from kfit.bench.held_out_views import held_out_views
from kfit.bench.paper import command as bench_paper
from kfit.bench.paper import drawings, fits, variants
from kfit.bench.paper.page import PUBLISHED, figures, page
from kfit.bench.paper.units import STUDIED, TABLES, Measuring, changer
from kfit.cli.main import main
from kfit.core import History, Observation
from kfit.data import build_views
from kfit.data.shapes import build as shapes_build
from kfit.generators import VAE3D
from kfit.geometry import CATEGORIES
from kfit.models import load

RECIPES = Path(__file__).parents[2] / "recipes"


@pytest.fixture
def how(tmp_path):
    training = variants.Training(12, 4, RECIPES, tmp_path / "cache", tmp_path / "runs")
    return Measuring(training, fits.Schedule(4, 2), fits.Schedule(2, 1), 2, 0, lambda what, done, total: None)


def made_up(tables, categories):
    """Arrays as `Measuring.measured` gives them, of invented numbers."""
    rng = np.random.default_rng(0)
    found = {}
    for table in tables:
        for category in [STUDIED] if table.endswith("robustness") else categories:
            for unit in TABLES[table]:
                if table.endswith("robustness"):
                    names = ["instances +0", *(f"{kind} {strength:+g}" for kind, strength in fits.levels())]
                    arrays = {name: rng.uniform(0, 90, 3) for name in names}
                else:
                    arrays = {
                        "rotation_deg": np.array([1.0, 7.0, np.nan, 50.0]),
                        "translation_cm": np.array([2.0, 3.0, np.nan, 4.0]),
                        "photos": rng.integers(0, 255, (2, 16, 16, 3), dtype=np.uint8),
                        "camera": np.tile([[40.0, 0, 8], [0, 40, 8], [0, 0, 1]], (2, 1, 1)),
                        "box_rotation": np.tile(np.eye(3), (2, 1, 1)),
                        "box_translation": np.array([[0, 0, 1.0], [np.nan] * 3]),
                        "box_size": np.full((2, 3), 0.1),
                    }
                    if "field+" in unit:
                        arrays["drawing"] = rng.integers(0, 255, (2, 3, 16, 16), dtype=np.uint8)
                    if "+" not in unit:
                        arrays |= {
                            "l1": np.array([0.06, 0.05, 0.04]),
                            "multiply_adds": np.array(0.45e9),
                            "samples": rng.integers(0, 255, (3, 3, 16, 16), dtype=np.uint8),
                            "path_energy": np.linspace([1] * 4, 0.2, 5).T,
                            "path_rotation": np.linspace([40] * 4, 5, 5).T,
                        }
                found[category, unit] = arrays
    return found


def test_the_page_shows_every_row_with_failures_as_the_worst(how):
    categories = ["laptop", "mug"]
    found = made_up(TABLES, categories)
    text = page(found, list(TABLES), categories, how, "kfit bench paper --views 4")
    rows = [line for line in text.splitlines() if line.startswith("| compact VAE2D (w/o 3D)")]
    assert rows == 2 * [
        "| compact VAE2D (w/o 3D) | 0.0600 | 0.0500 | 0.0400 | 28.5° | 25 [5, 70] | 50 [15, 85] | 50 [15, 85] "
        "| 75 [30, 95] | 3.0 cm | 0 [0, 0] | within the noise | 0.109 | 1.8 | 90.2 |"
    ]
    assert "`kfit bench paper --views 4`" in text
    assert "2 starts of 1 steps (the paper: 32 of 50)" in text
    assert "- **32 within the noise**" in text
    drawn = figures(found, list(TABLES), categories)
    assert {f"{name}.png" for name in drawn} == {part.split("(")[1][:-1] for part in text.split() if "png)" in part}
    for figure in drawn.values():
        figure.canvas.draw()


def test_rows_that_are_not_measured_yet_are_dashes_and_have_no_figures(how):
    found = made_up(["1a"], ["laptop"])
    del found["laptop", "full"]
    text = page(found, ["1a", "robustness"], ["laptop", "mug"], how, "kfit", 2)
    assert text.count(f"| compact VAE3D, code of 16 |{' – |' * 14}") == 2
    assert "Not measured yet." in text
    assert "iterations.png" not in text
    assert "for each of 2 seeds" in text


def test_backbones_stand_beside_their_arithmetic(how):
    text = page(made_up(["backbone"], ["laptop"]), ["backbone"], ["laptop"], how, "kfit")
    shares = "28.5° | 25 [5, 70] | 50 [15, 85] | 50 [15, 85] | 75 [30, 95] | 3.0 cm | 0.45 |"
    assert f"| RadianceField | 0.0600 | 0.0500 | 0.0400 | {shares}" in text
    assert f"| RadianceField, kfit's own fit | – | – | – | {shares}" in text
    assert drawings.multiply_adds(VAE3D()) == pytest.approx(0.45e9, rel=0.02)


def test_the_page_says_what_was_asked_for_and_no_more(how):
    text = page(made_up(["2a"], ["laptop"]), ["2a"], ["laptop"], how, "kfit")
    assert "Table 2a" in text
    assert "Table 1" not in text
    assert figures(made_up(["2a"], ["laptop"]), ["2a"], ["laptop"]) == {}


def test_the_regressor_starts_from_imagenet_where_its_file_is_given(how):
    words = replace(how.training, vgg16="vgg16.pth").command("regressor", "laptop")
    assert words[words.index("--model.init_args.weights") + 1] == "vgg16.pth"
    assert "--model.init_args.weights" not in how.training.command("regressor", "laptop")
    inputs = replace(how, training=replace(how.training, vgg16="vgg16.pth"))
    found = made_up(["curves"], ["laptop"])
    assert "regressor** is trained from ImageNet's weights" in page(found, ["curves"], ["laptop"], inputs, "kfit")
    assert "regressor** is trained from random weights" in page(found, ["curves"], ["laptop"], how, "kfit")


def test_a_file_of_weights_that_is_not_there_is_named(tmp_path, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["bench", "paper", "--vgg16", str(tmp_path / "none.pth")])
    assert ended.value.code == 2
    assert "--vgg16: there is no file" in capsys.readouterr().err


def test_every_published_row_has_its_place():
    assert all(unit in TABLES[table] for table, unit in PUBLISHED)
    assert all(unit.partition("+")[0] in variants.VARIANTS for table in TABLES.values() for unit in table)


@pytest.mark.parametrize("name", variants.VARIANTS)
def test_variants_differ_from_their_recipes_in_what_the_recipes_have(name, how):
    variant, words = variants.VARIANTS[name], how.training.command(name, "laptop")
    recipe = yaml.safe_load((RECIPES / variant.recipe).read_text())
    arguments = recipe["model"]["init_args"]
    for setting in variant.settings[::2]:
        assert setting.split(".")[2] in {*arguments, "kl_weight"}, setting
    assert words[words.index("--trainer.limit_train_batches") + 1] == "2"  # 12 steps in six parts


@pytest.fixture
def trainings(how, monkeypatch):
    """Words of each training of a mug's generator that is begun, and what sets how far it gets."""
    folder = how.training.folder("full", "mug") / "lightning_logs" / "version_0" / "checkpoints"
    folder.mkdir(parents=True)
    called = []

    def reached(steps):
        torch.save({"global_step": steps}, folder / "last.ckpt")

    monkeypatch.setattr(variants.Training, "_run", staticmethod(lambda words, log: called.append(words) or reached(12)))
    return called, reached


def test_what_is_trained_is_not_trained_again_and_what_is_half_trained_goes_on(how, trainings):
    called, reached = trainings
    reached(6)
    last = how.training.trained("full", "mug")
    assert called[0][-2:] == ["--ckpt_path", str(last)]
    how.training.trained("full", "mug")
    assert len(called) == 1


def test_a_training_with_other_settings_is_not_taken_for_this_one(how, trainings):
    how.training.trained("full", "mug")
    for other, changed in (({"steps": 6}, "train-steps"), ({"steps": 24, "objects": 9}, "train-steps and objects")):
        with pytest.raises(ValueError, match=f"full was trained with another {changed}; choose another --runs"):
            replace(how.training, **other).trained("full", "mug")
    assert len(trainings[0]) == 1


def test_a_training_that_ends_early_is_no_result(how, trainings):
    with pytest.raises(RuntimeError, match="was trained for 12 steps instead of 18; give more --objects"):
        replace(how.training, steps=18).trained("full", "mug")


def test_a_unit_is_measured_once_for_the_same_settings(how, monkeypatch, tmp_path):
    checkpoint = tmp_path / "last.ckpt"
    checkpoint.write_bytes(b"")
    (how.training.runs / "mug").mkdir(parents=True)
    monkeypatch.setattr(variants.Training, "trained", lambda *_: checkpoint)
    monkeypatch.setattr(variants.Training, "checkpoint", lambda *_: checkpoint)
    monkeypatch.setattr(Measuring, "_measure", lambda self, *asked: {"rotation_deg": np.ones(2)})
    assert how.saved("full+l1", "mug") is None
    how.measured("full+l1", "mug")
    assert how.saved("full+l1", "mug")["rotation_deg"].tolist() == [1, 1]
    assert replace(how, schedule=fits.Schedule(8, 2)).saved("full+l1", "mug") is None
    assert replace(how, published=fits.Schedule(8, 2)).saved("full+l1", "mug") is not None
    os.utime(checkpoint, (0, 0))  # trained anew
    assert how.saved("full+l1", "mug") is None


@pytest.mark.slow
def test_reconstruction_is_evaluated_on_objects_of_held_out_and_of_known_families(tmp_path):
    held_out, known, fitted = drawings.novel_view_l1(load("can"), tmp_path, 1)
    assert 0 < known < 0.2
    assert 0 < fitted < held_out < 0.2
    assert held_out != known
    assert {file.name.split("_")[1] for file in tmp_path.iterdir()} == {"train", "val"}


@pytest.mark.parametrize(
    "energy", [pytest.param(name, marks=pytest.mark.slow) if name in ("l2", "ssim") else name for name in fits.ENERGIES]
)
def test_a_fit_of_each_energy_runs_and_its_path_is_reported(energy):
    model = load("laptop")
    views = held_out_views(model, 1, 3)
    found = fits.by_fit(model, views, fits.paper_fit(model, fits.Schedule(2, 1), energy), lambda done: None)
    energies, rotations = fits.path_of(found.results, views, "laptop")
    assert energies.shape == rotations.shape == (1, 2)
    assert found.arrays()["drawing"].shape == (1, 3, 64, 64)
    assert found.arrays()["box_size"].shape == (1, 3)


def test_a_path_is_that_of_the_start_which_won():
    model = load("laptop")
    views = held_out_views(model, 1, 3)

    class Result:
        start = torch.tensor([1])
        history = History(
            torch.tensor([[[9.0, 3.0]], [[8.0, 2.0]]]),
            {},
            {name: torch.zeros(2, 1, 2) for name in ("azimuth", "elevation", "roll")},
        )

    energies, rotations = fits.path_of([Result()], views, "laptop")
    assert energies.tolist() == [[3, 2]]
    assert rotations.shape == (1, 2)


def test_a_hidden_handle_is_evaluated_by_the_axis():
    model = load("mug")
    views = held_out_views(model, 2, 0)
    rotated = views.rotation @ torch.tensor([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]], dtype=torch.float64)
    hidden = replace(views, visible=torch.tensor([True, False]))
    assert fits.errors(rotated, hidden, "mug").tolist() == pytest.approx([90, 0], abs=1e-4)


@pytest.mark.parametrize("kind", ["brightness", "occlusion", "shift"])
def test_no_change_leaves_views_as_they_are_and_more_changes_more(kind):
    image = torch.ones(2, 3, 32, 32)
    image[:, :, 8:24, 8:24] = 0.4
    mask = (image[:, :1] < 0.5).float()
    observed = Observation(image, mask, keys=(0, 1))
    away = [(changer(kind, s)(observed).image - image).abs().mean() for s in (0.0, 0.1, 0.3)]
    assert away[0] < 1e-6 < away[1] < away[2]


def test_objects_of_a_training_are_those_of_its_seed(tmp_path, monkeypatch):
    built = []

    def build(category, number, held_out=False):
        built.append((number, held_out))
        return shapes_build(category, number, held_out)

    monkeypatch.setattr("kfit.bench.held_out_views.build", build)
    monkeypatch.setattr("kfit.data.drawn_objects.shapes.build", build)
    held_out_views(load("can"), 1, training_seed=2)
    build_views(tmp_path / "views.h5", "can", 1, 1, 16, seed=2)
    assert built[0] == built[1]
    assert built[0][1] is False


def test_pictures_from_the_prior_are_as_many_as_asked_for():
    assert drawings.prior_samples(load("laptop"), 3, 0).shape == (3, 3, 64, 64)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--tables", "[1c]"], "--tables: unknown 1c; known are 1a, paper_1a, 2a, paper_2a, 1b, paper_1b, curves"),
        (["--categories", "[cup]"], "--categories: unknown cup; known are"),
        (["--train-steps", "100"], "--train-steps must be a multiple of 6, got 100"),
        (["--starts", "1"], "--starts must be at least 2, got 1"),
        (["--recipes", "nowhere"], "no recipe at nowhere/vae3d.yaml; run this in kfit's checkout, or pass --recipes"),
    ],
)
def test_mistakes_get_a_sentence(words, message, capsys, tmp_path):
    with pytest.raises(SystemExit, match="2"):
        main(["bench", "paper", "--tables", "[1b]", "--runs", str(tmp_path), *words])
    assert message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_the_command_on_the_page_says_only_what_differs():
    args = bench_paper.parser().parse_args(["--categories", "[laptop]", "--views", "20", "--out", "elsewhere"])
    assert bench_paper._command(args) == "kfit bench paper --categories '[laptop]' --views 20"


@pytest.fixture
def measured(monkeypatch, tmp_path):
    """Rows that are measured, one after the other; the fourth of the first run fails."""
    saved, asked = {}, []

    def measure(self, unit, category):
        if len(asked) == 3:
            asked.append("failed")
            raise RuntimeError("training failed")
        asked.append((self.training.seed, category, unit))
        saved[asked[-1]] = made_up([table for table in TABLES if unit in TABLES[table]], [category])[category, unit]
        return saved[asked[-1]]

    monkeypatch.setattr(Measuring, "measured", measure)
    monkeypatch.setattr(
        Measuring, "saved", lambda self, unit, category: saved.get((self.training.seed, category, unit))
    )
    words = ["--tables", "[1a]", "--categories", "[can]", "--seeds", "2", "--out", str(tmp_path / "out")]
    return ["bench", "paper", *words, "--runs", str(tmp_path / "runs"), "--cache", str(tmp_path / "cache")], asked


def test_an_interrupted_run_leaves_its_page_and_measures_only_the_rest(measured, tmp_path, capsys):
    words, asked = measured
    with pytest.raises(SystemExit):
        main(words)
    page = (tmp_path / "out" / "README.md").read_text()
    assert "| compact VAE2D (w/o 3D) | 0.0600" in page
    assert "objects of seed 0" in page
    main(words)
    assert len(asked) == 3 + 1 + 3
    assert len(set(asked)) == 7
    page = (tmp_path / "out" / "README.md").read_text()
    assert "for each of 2 seeds" in page
    assert "row 3 of 3" in capsys.readouterr().err


def test_a_run_out_of_time_writes_what_was_measured_before(measured, tmp_path, capsys):
    words, asked = measured
    with pytest.raises(SystemExit):
        main(words)
    main([*words, "--hours", "1e-9"])
    assert len(asked) == 4
    assert "3 rows are left; the same command goes on" in capsys.readouterr().err
    assert (tmp_path / "out" / "iterations.png").is_file()


def test_all_tables_and_categories_are_the_default(monkeypatch, tmp_path, capsys):
    asked = set()
    monkeypatch.setattr(Measuring, "saved", lambda self, unit, category: asked.add((unit, category)))
    weights = tmp_path / "vgg16.pth"
    weights.write_bytes(b"")
    words = ["bench", "paper", "--hours", "1e-9", "--out", str(tmp_path / "out")]
    for vgg16, tables in (([], [t for t in TABLES if not t.startswith("paper_")]), (["--vgg16", str(weights)], TABLES)):
        asked.clear()
        with pytest.raises(SystemExit):
            main([*words, *vgg16])
        assert "left no time for a row" in capsys.readouterr().err
        assert {category for _, category in asked} == set(CATEGORIES)
        assert {unit for unit, _ in asked} == {unit for table in tables for unit in TABLES[table]}


def test_levels_start_with_nothing():
    kinds = {}
    for kind, strength in fits.levels():
        kinds.setdefault(kind, []).append(strength)
    assert all(strengths[0] == 0 for strengths in kinds.values())
    assert math.isclose(kinds["shift"][2], 0.25)
