"""Categories as recipes give them."""

import sys

import pytest

from kfit.data import ViewsDataModule, build, read_category
from kfit.geometry import CATEGORIES, Category

POTS = """
import numpy as np
import trimesh
from kfit.data import Mesh
from kfit.data.shapes import textures
from kfit.geometry import Category

TEAPOT = Category("teapot", 0.28, shapes="own_pots")


def build(rng, held_out):
    from kfit.data.shapes.primitives import revolve
    outline = np.array([(0.0, 0.0), (0.5, 0.0), (0.4, rng.uniform(0.5, 1.0)), (0.0, 0.6)])
    return revolve(outline, textures.solid((9, 9, 9)), 12)
"""


@pytest.fixture
def own_pots(tmp_path, monkeypatch):
    (tmp_path / "own_pots.py").write_text(POTS)
    monkeypatch.syspath_prepend(str(tmp_path))
    yield tmp_path
    sys.modules.pop("own_pots", None)


def test_a_category_is_named_or_lies_in_a_small_file(tmp_path):
    assert read_category("mug") is CATEGORIES["mug"]
    (tmp_path / "c.yaml").write_text("name: vase\nmean_diagonal: 0.3\nsymmetry: y\nmirror: no\nsides: [0.6, 1, 0.6]")
    found = read_category(str(tmp_path / "c.yaml"))
    assert (found.name, found.symmetry, found.mirror, found.sides) == ("vase", "y", False, (0.6, 1.0, 0.6))


def test_a_category_in_a_module_brings_its_shapes(own_pots):
    found = read_category("own_pots.TEAPOT")
    meshes = [build(found, seed)[0] for seed in (0, 0, 1)]
    assert (meshes[0].vertices == meshes[1].vertices).all()
    assert (meshes[0].vertices != meshes[2].vertices).any()


@pytest.mark.parametrize(
    ("category", "message"),
    [
        ("mugg", "did you mean mug"),
        ("nowhere.yaml", "there is no nowhere.yaml"),
        ("own_pots.build", "but own_pots.build is function"),
        ("own_pots.NONE", "but own_pots.NONE is NoneType"),
    ],
)
def test_what_names_no_category_gets_a_sentence(own_pots, category, message):
    with pytest.raises((ValueError, FileNotFoundError), match=message):
        read_category(category)


def test_the_file_of_a_category_s_name_in_the_folder_is_suggested(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "lamptop.yaml").touch()
    with pytest.raises(ValueError, match=r"got 'lamptop'; did you mean lamptop\.yaml\?"):
        read_category("lamptop")


def test_a_file_that_is_no_category_names_itself(tmp_path):
    for number, text in enumerate(("- a", "{", "name: a\n", "name: a\nmean_diagonal: big\n")):
        path = tmp_path / f"{number}.yaml"
        path.write_text(text)
        with pytest.raises(ValueError, match=f"{number}.yaml"):
            read_category(str(path))


def test_shapes_of_a_card_are_never_imported_for_it(own_pots):
    stranger = Category("teapot", 0.28, shapes="own_pots")
    with pytest.raises(ValueError, match="not imported: --import own_pots"):
        build(stranger, 0)
    assert "own_pots" not in sys.modules


def test_views_of_one_s_own_category_tell_all_of_it_to_the_checkpoint(own_pots, tmp_path):
    own = ViewsDataModule("own_pots.TEAPOT", 2, 2, 8, cache_dir=str(tmp_path), num_val_objects=1)
    assert Category.of_dict(own.hparams["category"]) == own.category
    assert ViewsDataModule("mug").hparams["category"] == "mug"
    own.prepare_data()
    own.setup()
    assert len(own.train_pairs) == 4


def test_a_category_without_shapes_asks_for_meshes(tmp_path):
    with pytest.raises(ValueError, match="vase has no shapes to draw, so meshes or views must be given"):
        ViewsDataModule(Category("vase", 0.3))


def test_a_module_that_is_not_found_is_looked_for_on_the_path(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "needy_pots.py").write_text("import nothing_of_the_kind\n")
    with pytest.raises(
        ImportError, match="No module named 'no_pots'; its folder must be the working folder or on PYTHO"
    ):
        read_category("no_pots.TEAPOT")
    with pytest.raises(ImportError, match=r"No module named 'nothing_of_the_kind'$"):
        read_category("needy_pots.TEAPOT")
