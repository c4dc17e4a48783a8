"""A damaged or wrong recipe ends in a sentence, executes nothing and writes nothing."""

import sys
from pathlib import Path

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from kfit.models import load
from kfit.pose.fit_recipe import fit_of
from kfit.training import lightning_cli as lightning

RECIPES = sorted((Path(__file__).parents[2] / "recipes").glob("*.yaml"))
FIT = next(path for path in RECIPES if path.stem == "fit_released")
TRAINED = [path for path in RECIPES if path.stem not in ("fit_released", "fit_learned")]
# What no recipe is, whichever part of kfit reads it; "pwned" would be a file in the working folder.
NO_RECIPES = {
    "a list": "- 1\n- 2\n",
    "a number": "5",
    "empty": "",
    "binary": bytes(range(256)),
    "zeros": b"\0\0\0",
    "cut off": "model: [1, 2",
    "nested too deeply": "model: " + "[" * 3000 + "]" * 3000,
    "within itself": "model: &m\n  class_path: *m\n",
    "a tag": 'model: !!python/object/apply:os.system ["touch pwned"]\n',
    "a tag alone": '!!python/object/apply:os.system ["touch pwned"]\n',
    "a tagged name": "model: !!python/name:os.system\n",
    "a function": "model:\n  class_path: os.system\n  init_args: {command: touch pwned}\n",
}
QUICK = ("binary", "a tag", "a function")  # the others run with --runslow
CASES = [
    pytest.param(text, id=name, marks=() if name in QUICK else pytest.mark.slow) for name, text in NO_RECIPES.items()
]
FEW = settings(max_examples=16, derandomize=True, deadline=None, database=None, suppress_health_check=list(HealthCheck))
VALUES = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers(-9, 9) | st.text(max_size=4),
    lambda inner: st.lists(inner, max_size=2) | st.dictionaries(st.text(max_size=4), inner, max_size=2),
    max_leaves=4,
)


@pytest.fixture(autouse=True)
def alone(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["lightning"])
    monkeypatch.setattr(sys, "path", list(sys.path))
    # Lightning 2.6 calls jsonargparse by a name that 4.53 has deprecated.
    monkeypatch.setenv("JSONARGPARSE_DEPRECATION_WARNINGS", "off")


@pytest.fixture(scope="module")
def model():
    return load("mug")


def written(text):
    """A recipe in the working folder, where nothing else is."""
    path = Path("recipe.yaml")
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def parsed(path, like):
    """Exit status of Lightning's command line that reads a recipe and would print what it understood."""
    command = "predict" if like.stem == "fit_dataset" else "fit"
    with pytest.raises(SystemExit) as end:
        lightning.main([command, "-c", str(path), "--print_config"])
    return end.value.code


def refused(capsys, path, like, *words):
    capsys.readouterr()
    assert parsed(path, like) == 2
    out, printed = capsys.readouterr()
    assert out == ""
    assert "Traceback" not in printed
    assert all(word in printed for word in words)
    assert [file.name for file in Path().iterdir()] in ([], ["recipe.yaml"])


def wrong(recipe):
    """Changes of a recipe of training, each with what must be told of it."""
    part = recipe["model"]
    args = part.get("init_args", {})
    return {
        "an unknown key": (recipe | {"modle": 1}, "modle"),
        "an unknown argument": (recipe | {"model": part | {"init_args": args | {"gone": 1}}}, "gone"),
        "a wrong type": (recipe | {"trainer": recipe["trainer"] | {"max_epochs": "many"}}, "max_epochs"),
        "no such class": (recipe | {"model": part | {"class_path": "kfit.training.Gone"}}, "Gone"),
        "no such module": (recipe | {"model": part | {"class_path": "gone.Gone"}}, "No module named 'gone'"),
        "another kind of class": (recipe | {"model": "kfit.energies.L1"}, "LightningModule"),
        "another kind of data": (recipe | {"data": "kfit.energies.L1"}, "LightningDataModule"),
    }


@pytest.mark.slow
@pytest.mark.parametrize("recipe", TRAINED, ids=lambda path: path.stem)
def test_a_recipe_of_the_repository_is_understood_and_its_mistakes_are_reported(recipe, capsys):
    assert parsed(recipe, recipe) == 0
    for change, words in wrong(yaml.safe_load(recipe.read_text())).values():
        refused(capsys, written(yaml.safe_dump(change)), recipe, words)


@pytest.mark.parametrize("text", CASES)
def test_what_is_no_recipe_is_refused(text, capsys):
    refused(capsys, written(text), TRAINED[-1])


def test_a_missing_recipe_and_a_folder_are_reported(capsys, tmp_path):
    refused(capsys, "gone.yaml", TRAINED[-1], "gone.yaml")
    refused(capsys, tmp_path, TRAINED[-1], str(tmp_path))


@pytest.mark.slow
@FEW
@given(st.binary(max_size=60) | VALUES.map(lambda value: yaml.safe_dump(value).encode()))
def test_whatever_bytes_a_file_holds_lightning_ends_in_order(text):
    assert parsed(written(text), TRAINED[-1]) in (0, 2)


def one_sentence(model, text, *words):
    with pytest.raises(ValueError, match=r"recipe\.yaml is no recipe( of a fit)?: ") as error:
        fit_of(written(text), model)
    message = str(error.value)
    assert "\n" not in message
    assert len(message) < 400
    assert message[-1] != ":"
    assert all(word in message for word in words)
    assert [file.name for file in Path().iterdir()] == ["recipe.yaml"]


def fit():
    """The released fit, without the network that would be fetched."""
    return yaml.safe_load(FIT.read_text()) | {"energies": {"image": "kfit.energies.L1"}}


@pytest.mark.parametrize("text", CASES)
def test_what_is_no_fit_is_refused(model, text):
    one_sentence(model, text.replace("model", "optimizer") if isinstance(text, str) else text)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"zz": 1}, "zz"),
        ({"num_starts": "many"}, "num_starts"),
        ({"num_starts": -1}, "num_starts must be at least 1"),
        ({"num_steps": True}, "num_steps"),
        ({"weights": {"image": float("nan")}}, "weights of image must be finite"),
        ({"selector": "kfit.selectors.Gone"}, "no attribute 'Gone'"),
        ({"selector": "gone.Gone"}, "No module named 'gone'"),
        ({"optimizer": "kfit.energies.L1"}, "kfit.energies.L1"),
        ({"optimizer": "os.getcwd"}, "os.getcwd"),
        ({"optimizer": {"class_path": "kfit.optimizers.Adam", "init_args": {"rates": -1}}}, "rates must be above 0"),
        ({"initializers": []}, "initializers"),
        ({"energies": {}}, "energies"),
        ({"energies": [1]}, "energies"),
        ({"energies": {"a.b": "kfit.energies.L1"}}, "a.b"),
        ({"energies": {"__class__": "kfit.energies.L1"}}, "cannot be named '__class__'"),
        ({"energies": {"keys": "kfit.energies.L1"}}, "cannot be named 'keys'"),
    ],
)
def test_a_fit_s_mistake_gets_one_sentence(model, change, words):
    one_sentence(model, yaml.safe_dump(fit() | change), words)


def test_an_unquoted_on_is_a_name(model):
    text = yaml.safe_dump(fit()).replace("kfit.energies.L1", "kfit.energies.L1\n  prior: {class_path: CODE}")
    text = text.replace("CODE", "kfit.energies.CodePrior, init_args: {on: code}")
    assert "on: code" in text
    assert fit_of(written(text), model).energies["prior"].on == "code"


def test_a_module_that_ends_the_program_ends_in_a_sentence(model, monkeypatch, capsys, tmp_path):
    modules = tmp_path.parent / f"{tmp_path.name}_modules"
    modules.mkdir()
    (modules / "that_exits.py").write_text("import sys\nsys.exit(0)\n")
    monkeypatch.syspath_prepend(str(modules))
    message = "module that_exits ends the program when it is imported"
    one_sentence(model, yaml.safe_dump(fit() | {"optimizer": "that_exits.Adam"}), message)
    recipe = yaml.safe_load(TRAINED[-1].read_text()) | {"model": "that_exits.Model"}
    refused(capsys, written(yaml.safe_dump(recipe)), TRAINED[-1], message)


def test_a_fit_s_parts_must_be_there(model):
    assert fit_of(written(yaml.safe_dump(fit())), model).num_starts == 32
    for name in ("optimizer", "energies", "initializers"):
        recipe = fit()
        del recipe[name]
        one_sentence(model, yaml.safe_dump(recipe), name)


@pytest.mark.slow
@FEW
@given(
    st.sampled_from(["optimizer", "selector", "num_starts", "num_steps", "weights", "energies", "callbacks"]), VALUES
)
def test_whatever_a_fit_s_entry_is_it_works_or_gets_one_sentence(model, name, value):
    text = yaml.safe_dump(fit() | {name: value})
    try:
        fit_of(written(text), model)
    except ValueError:
        one_sentence(model, text)
