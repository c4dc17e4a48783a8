from __future__ import annotations

import os
import sys
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from model_file import as_version_01, card_of, put_card
from safetensors.torch import load, save

import kfit
from kfit.generators import PoseHead
from kfit.geometry import CATEGORIES
from kfit.models import bundled, read_card, read_checkpoint, read_model, write_model
from kfit.pose import CategoryModel


def edit(path: Path, **changes: object) -> None:
    put_card(path, card_of(path) | changes)


def test_a_written_model_draws_the_same_pictures_to_half_precision(tiny_model: CategoryModel, tiny_file: Path) -> None:
    values = {"code": torch.randn(2, 4), "azimuth": torch.tensor([0.3, 2.0]), "elevation": torch.tensor([0.1, 0.8])}
    read = kfit.load(tiny_file)
    with torch.no_grad():
        assert torch.allclose(read.generator(**values).image, tiny_model.generator(**values).image, atol=2e-3)
    assert read.card == tiny_model.card


def test_a_model_keeps_its_pose_head(tiny_model: CategoryModel, tmp_path: Path) -> None:
    settings = {"class_path": "kfit.generators.PoseHead", "init_args": {"channels": [8, 8, 8, 8], "hidden_dim": 8}}
    head, path = PoseHead(**settings["init_args"]).eval(), tmp_path / "headed.safetensors"
    parts = {"generator": tiny_model.generator, "encoder": tiny_model.encoder, "extents": tiny_model.extents}
    card = replace(tiny_model.card, networks=tiny_model.card.networks | {"pose_head": settings})
    write_model(path, parts | {"pose_head": head}, card)
    read, picture = kfit.load(path).pose_head, torch.rand(1, 3, 64, 64)
    assert isinstance(read, PoseHead)
    with torch.no_grad():
        assert torch.allclose(read(picture), head(picture), atol=1e-2)
    edit(path, networks=card.networks | {"pose_head": card.networks["encoder"]})
    with pytest.raises(ValueError, match="ConvEncoder' as pose_head: no network of kfit"):
        kfit.load(path)


def test_writing_leaves_no_temporary_file(tiny_file: Path) -> None:
    assert [path.name for path in tiny_file.parent.iterdir()] == ["tiny.safetensors"]


def test_a_truncated_file_gets_a_sentence(tiny_file: Path) -> None:
    tiny_file.write_bytes(tiny_file.read_bytes()[:1000])
    with pytest.raises(ValueError, match=r"tiny\.safetensors is damaged or no safetensors file"):
        read_model(tiny_file)


def test_a_missing_model_or_card_gets_a_sentence(tiny_file: Path) -> None:
    with pytest.raises(FileNotFoundError, match="no model at"):
        read_model(tiny_file.with_name("other.safetensors"))
    tiny_file.write_bytes(save(load(tiny_file.read_bytes())))
    for read in (read_model, read_card):
        with pytest.raises(ValueError, match=r"tiny\.safetensors holds no model card, and there is none at"):
            read(tiny_file)


def test_a_card_that_names_other_sizes_gets_a_sentence(tiny_file: Path) -> None:
    networks = card_of(tiny_file)["networks"]
    networks["encoder"]["init_args"]["channels"] = [8, 8, 8, 16]
    edit(tiny_file, networks=networks)
    with pytest.raises(ValueError, match="does not fit its card: the weights are not those of the encoder"):
        read_model(tiny_file)


@pytest.mark.parametrize(
    "class_path",
    ["os.system", "subprocess.Popen", "antigravity.fly", "kfit.fitting.pipeline.FitPipeline.of", "torch.nn.nothing"],
)
def test_a_card_can_neither_import_a_module_nor_call_a_function(tiny_file: Path, class_path: str) -> None:
    networks = card_of(tiny_file)["networks"]
    edit(tiny_file, networks=networks | {"generator": {"class_path": class_path, "init_args": {}}})
    with pytest.raises(ValueError, match="no network of kfit, nor of a module imported before"):
        read_model(tiny_file)
    assert "antigravity" not in sys.modules


def test_a_card_of_another_layout_gets_a_sentence(tiny_file: Path) -> None:
    edit(tiny_file, format=99)
    with pytest.raises(ValueError, match="holds no model card of format 1"):
        read_model(tiny_file)
    put_card(tiny_file, "{")
    with pytest.raises(ValueError, match=r"tiny\.safetensors holds no model card: Expecting"):
        read_card(tiny_file)


def test_a_pair_of_files_of_version_0_1_is_read(tiny_model: CategoryModel, tiny_file: Path) -> None:
    as_version_01(tiny_file)
    assert read_card(tiny_file) == kfit.load(tiny_file).card == tiny_model.card
    tiny_file.with_suffix(".json").write_text("{")
    with pytest.raises(ValueError, match=r"tiny\.json holds no model card"):
        kfit.load(tiny_file)


def test_a_card_of_another_model_in_the_same_folder_is_not_taken(tiny_model: CategoryModel, tiny_file: Path) -> None:
    tiny_file.with_suffix(".json").write_text(replace(tiny_model.card, category="can").to_json())
    assert kfit.load(tiny_file).card.category == "mug"


def test_weights_and_card_stay_together_while_the_file_is_replaced(tiny_model: CategoryModel, tmp_path: Path) -> None:
    path, asides = tmp_path / "model.safetensors", {}
    for number, category in enumerate(("mug", "can")):
        with torch.no_grad():
            tiny_model.extents.layers[-1].bias.fill_(number)
        asides[category] = tmp_path / f"{category}.safetensors"
        write_model(asides[category], tiny_model.networks, replace(tiny_model.card, category=category))
    os.link(asides["mug"], path)
    read = Path.read_bytes

    def replaced_meanwhile(place: Path) -> bytes:
        content = read(place)
        asides["can"].replace(path)
        return content

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Path, "read_bytes", replaced_meanwhile)
        first = kfit.load(path)
    for category, model in (("mug", first), ("can", kfit.load(path))):
        assert model.card.category == category
        assert (model.extents.layers[-1].bias == (category == "can")).all()


def test_an_unknown_category_lists_those_known() -> None:
    with pytest.raises(ValueError, match=r"category 'teapot' has no bundled model; those known are .*laptop.*mug"):
        kfit.load("teapot")


def test_something_else_than_a_checkpoint_gets_a_sentence(tmp_path: Path) -> None:
    path = tmp_path / "x.ckpt"
    torch.save({"state_dict": {}}, path)
    with pytest.raises(ValueError, match=r"x\.ckpt is no checkpoint by `lightning fit`"):
        read_checkpoint(path)


@pytest.mark.parametrize("category", bundled())
def test_a_bundled_model_has_a_whole_card_and_few_megabytes(category: str) -> None:
    model = kfit.load(category)
    assert model.card.category == category
    assert model.card.training["command"]
    assert model.card.accuracy
    folder = Path(kfit.models.__file__).parent / "bundled"
    assert (folder / f"{category}.safetensors").stat().st_size < 9e6


def test_every_category_is_bundled() -> None:
    assert set(bundled()) == set(CATEGORIES)
