"""Whatever an option of a command is given, it works or is refused in one line that names it, before any work."""

from __future__ import annotations

import argparse
import functools
import logging
import os
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

import kfit.models
from kfit.bench.command import BENCHMARKS
from kfit.cli import main as command_line
from kfit.cli.main import COMMANDS, main
from kfit.cli.pose_arguments import _number
from kfit.fitting.pipeline import FitPipeline

ROOT = Path(__file__).parents[2]
FEW = settings(max_examples=6, derandomize=True, deadline=None, database=None, suppress_health_check=list(HealthCheck))
RUNS = {**COMMANDS, **{f"bench {name}": part for name, part in BENCHMARKS.items()}}
# Words without which a command is not understood.
NEEDED = {
    "pose": ["photo.png"], "video": ["frames"], "evaluate": ["results"],
    "pack": ["last.ckpt", "--out", "m.safetensors"], "calibrate": ["--model", "m.safetensors"],
    "export": ["mug", "--out", "o"], "completion": ["bash"],
    "bench speed": ["--model", "m.safetensors"], "bench photos": ["photos"],
    "views": ["--show", "s"],
}  # fmt: skip


class Reached(BaseException):
    """Work has begun."""


def reach(*_: Any, **__: Any) -> None:
    raise Reached


@pytest.fixture(autouse=True)
def alone(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """In an empty folder; parsers and models are made once."""
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    monkeypatch.setattr(command_line, "parser", PARSER)
    monkeypatch.setattr(kfit.models, "load", LOAD)


PARSER, LOAD = functools.cache(command_line.parser), functools.cache(kfit.models.load)


def options() -> list[tuple[str, argparse.Action]]:
    """Every option of every command that takes a value."""
    found = []
    for name in RUNS:
        part = PARSER()
        for word in name.split():
            part = part._subcommands_action.choices[word]
        for action in part._actions:
            if action.option_strings and action.nargs != 0 and action.help:
                found.append((name, action))
    return found


OPTIONS = options()
IDS = [f"{name} {action.option_strings[0]}" for name, action in OPTIONS]
LETTERS = st.text("xyzß一 ;$'\"{}", min_size=1, max_size=5).map(lambda text: f"x{text}")


def kind(action: argparse.Action) -> Any:
    return getattr(action, "_typehint", action.type)


def words_for(action: argparse.Action) -> st.SearchStrategy[str] | None:
    """Words that are no value of an option, by its type."""
    if action.choices or "Literal" in str(kind(action)):
        return LETTERS | st.sampled_from(["", "null", "1", "[32]"])
    strange = st.sampled_from(["", "null", "[1]", "{a: 1}", "1 2", "--", "0x", "1,5", "true"])
    return {
        int: LETTERS | strange | st.sampled_from(["1.5", ".nan", ".inf", "1e3", str(10**30), str(-(10**30))]),
        float: LETTERS | strange | st.sampled_from(["nan", ".nan", ".inf", "-.inf", "1e400"]),
        _number: LETTERS | strange | st.sampled_from(["nan", ".nan", ".inf", "-.inf", "1e400"]),
        bool: LETTERS | st.sampled_from(["", "null", "2", "[true]"]),
        list[str]: LETTERS | st.sampled_from(["", "null", "1", "{a: 1}", "[[]]", "[1]", "[mug,"]),
    }.get(kind(action))


def refused(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """What is said of words that end with status 2, on one line, and leave nothing."""
    with pytest.raises(SystemExit) as end:
        main(words)
    out, err = capsys.readouterr()
    assert (end.value.code, out, err.count("\n")) == (2, "", 1), (words, err)
    assert "Traceback" not in err
    assert not list(Path().iterdir()), words
    return err


def with_option(name: str, option: str, *values: str) -> list[str]:
    others = list(NEEDED.get(name, []))
    if option in others:
        del others[others.index(option) : others.index(option) + 2]
    return [*name.split(), *others, *([f"{option}={values[0]}"] if len(values) == 1 else [option, *values])]


def test_every_command_is_asked() -> None:
    assert {name for name, _ in OPTIONS} >= {*RUNS} - {"bench", "info", "completion"}
    assert len(OPTIONS) > 90


@pytest.mark.slow
@pytest.mark.parametrize(("name", "action"), OPTIONS, ids=IDS)
def test_a_value_of_another_type_is_refused_by_its_option(
    name: str, action: argparse.Action, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    option, wrong = action.option_strings[0], words_for(action)
    if wrong is None:
        pytest.skip("any text is a value")
    monkeypatch.setattr(RUNS[name], "run", reach)

    @FEW
    @given(wrong)
    def whatever(word: str) -> None:
        values = [word] * (action.nargs if isinstance(action.nargs, int) else 1)
        assert option in refused(with_option(name, option, *values), capsys)

    whatever()
    if isinstance(action.nargs, int):
        refused(with_option(name, option, *["1"] * (action.nargs - 1)), capsys)


@pytest.mark.slow
@pytest.mark.parametrize("name", RUNS)
def test_unknown_options_and_beginnings_of_known_ones_are_refused(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    if name == "bench":
        return
    monkeypatch.setattr(RUNS[name], "run", reach)
    for word in ("--nonsense", "--see=1", "--ou=x"):
        assert word in refused([*name.split(), *NEEDED.get(name, []), word], capsys)


PLACES = ("out", "report", "animation", "mesh", "runs", "cache")
WRITTEN = [(name, a.option_strings[0]) for name, a in OPTIONS if a.dest in PLACES]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "option"), WRITTEN)
def test_a_place_that_cannot_be_written_to_is_refused_before_any_work(
    name: str, option: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(RUNS[name], "run", reach)
    (tmp_path / "file").touch()
    (tmp_path / "folder.safetensors").mkdir()
    ends = {"--report": "p.html", "--animation": "p.gif", "--mesh": "p.glb"}.get(
        option, "m.safetensors" if name == "pack" else ""
    )
    for place in ("", f"{tmp_path}/file/{ends}", f"{tmp_path}/file/under/{ends}", f"{tmp_path}/{'x' * 300}/{ends}"):
        assert option in refused(with_option(name, option, place), capsys)
    with pytest.raises(Reached):
        main(with_option(name, option, f"{tmp_path}/new/folder/{ends}"))
    assert not (tmp_path / "new").exists()


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A photo with its mask, a folder of frames, a model, and what is none of these."""
    folder = tmp_path_factory.mktemp("files")
    noise = np.random.default_rng(0).integers(0, 256, (48, 64, 3), np.uint8)
    Image.fromarray(noise).save(folder / "photo.png")
    mask = np.zeros((48, 64), np.uint8)
    mask[10:40, 10:50] = 255
    Image.fromarray(mask).save(folder / "mask.png")
    (folder / "frames").mkdir()
    (folder / "empty").mkdir()
    for number in range(2):
        shutil.copy(folder / "photo.png", folder / f"frames/{number}.png")
    shutil.copy(Path(kfit.models.__file__).parent / "bundled/bowl.safetensors", folder / "own.safetensors")
    (folder / "cut.safetensors").write_bytes((folder / "own.safetensors").read_bytes()[:5000])
    for end in ("", ".onnx", ".yaml", ".npy", ".ckpt", ".pkl", ".safetensors", ".pth", ".mp4", ".json"):
        (folder / f"garbage{end}").write_bytes(b"garb\0age")
    os.mkfifo(folder / "pipe")
    return folder


# Options that name what is read, with the other words of a command that would work, and endings that they ask for.
READ = {
    "pose photo": (["--category", "mug"], ""),
    "pose --mask": (["{}/photo.png", "--category", "mug"], ""),
    "pose --segmenter": (["{}/photo.png", "--category", "mug"], ".onnx"),
    "pose --depth": (["{}/photo.png", "--category", "mug", "--mask", "{}/mask.png"], ".npy"),
    "pose --relative-poses": (["{}/photo.png", "{}/mask.png", "--category", "mug"], ".json"),
    "pose --ignore": (["{}/photo.png", "--category", "mug", "--mask", "{}/mask.png"], ""),
    "pose --model": (["{}/photo.png", "--mask", "{}/mask.png"], ".safetensors"),
    "pose --fit": (["{}/photo.png", "--category", "mug", "--mask", "{}/mask.png"], ".yaml"),
    "video frames": (["--category", "mug", "--mask", "{}/mask.png"], ".mp4"),
    "video --mask": (["{}/frames", "--category", "mug"], ""),
    "video --masks": (["{}/frames", "--category", "mug"], ""),
    "evaluate predictions": ([], ".pkl"),
    "pack checkpoint": (["--out", "m.safetensors"], ".ckpt"),
    "calibrate --model": ([], ".safetensors"),
    "export model": (["--out", "o"], ".safetensors"),
    "bench accuracy --model": ([], ".safetensors"),
    "bench accuracy --nocs": (["--categories", "[mug]", "--views", "0"], ""),
    "bench minimum --model": ([], ".safetensors"),
    "bench paper --vgg16": ([], ".pth"),
    "bench speed --model": (["--recipe", str(ROOT / "recipes/fit_released.yaml")], ".safetensors"),
    "bench speed --recipe": (["--model", "{}/own.safetensors"], ".yaml"),
    "bench dataset --category": ([], ""),
    "bench scaling --category": ([], ""),
    "bench optimizers --category": ([], ""),
    "bench following --categories": ([], ""),
    "bench training --recipes": ([], ".yaml"),
    "bench photos folder": ([], ""),
}


QUICK = ("pose photo", "pose --mask", "pose --depth", "pose --relative-poses", "video frames", "calibrate --model")


@pytest.mark.parametrize(
    "what", [what if what in QUICK else pytest.param(what, marks=pytest.mark.slow) for what in READ]
)
def test_what_is_no_file_of_its_kind_is_refused_before_a_fit(
    what: str, files: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(FitPipeline, "forward", reach)
    *command, option = what.split()
    others, end = READ[what]
    for word in ("gone", f"gone{end}", f"{files}/empty", f"{files}/garbage", f"{files}/garbage{end}", f"{files}/pipe"):
        if what == "bench paper --vgg16" and "garbage" in word:
            continue  # looked into when it is needed
        value = f"[{word}]" if option in ("--categories", "--recipes") else word
        inputs = [f"{option}={value}"] if option.startswith("--") else [value]
        words = [*command, *inputs, *(part.format(files) for part in others)]
        message = refused(words, capsys)
        assert Path(word).stem in message or option in message or f" {option.lstrip('-')} " in message, (words, message)


# Values of the right type that are out of range, and what is told of them beside their option.
RANGES = {
    "bench accuracy": ["--views=-1", "--hidden=1", "--scan-views=0", "--starts=0", "--steps=-1", "--categories=[]"],
    "bench energies": ["--views=-1", "--scan-views=0", "--starts=0", "--steps=-1", "--categories=[]"],
    "bench dataset": ["--objects=0", "--batch-size=0"],
    "bench following": ["--clips=0", "--frames=1", "--every=0", "--categories=[]", "--categories=[mug,nope]"],
    "bench minimum": ["--views=0", "--off=-1", "--off=181", "--seed=-1", "--categories=[]"],
    "bench optimizers": ["--problems=0", "--starts=0", "--budget=0"],
    "bench registration": ["--size=0", "--size=65", "--noise=-1", "--noise=1e30", "--draws=0", "--pictures=[nope]"],
    "bench paper": ["--tables=[nope]", "--categories=[]", "--train-steps=1", "--objects=0", "--views=0", "--starts=0"],
    "bench scaling": ["--fits=0"],
    "bench speed": ["--views=0", "--timed=-1", "--timed=101", "--repeats=0"],
    "bench training": ["--steps=0", "--recipes=[]"],
    "calibrate": ["--views=1", "--model=m.pt"],
    "pack": ["--pose-weight=-1", "--out=m.pt"],
    "app": ["--port=0", "--port=-1", "--port=65536", "--host=", "--host=256.1.1.1", "--host=a b"],
    "pose": ["--report=p.txt", "--animation=p.png", "--model=m.pt"],
    "evaluate": ["--scale-agnostic --poses=other"],
}


@pytest.mark.slow
@pytest.mark.parametrize("name", RANGES)
def test_numbers_out_of_range_are_refused_before_any_work(
    name: str, files: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(FitPipeline, "forward", reach)
    other = {"pose": [f"{files}/photo.png", "--mask", f"{files}/mask.png"]}.get(name, NEEDED.get(name, []))
    for words in RANGES[name]:
        option = words.partition("=")[0].split()[0]
        others = list(other)
        if option in others:
            del others[others.index(option) : others.index(option) + 2]
        if name == "pose" and option != "--model":
            others += ["--category", "mug"]
        message = refused([*name.split(), *others, *words.split(maxsplit=1 if "--poses" in words else 0)], capsys)
        assert option in message or option.lstrip("-") in message or "nope" in message


TREES = {
    "--trainer.max_epochs=many": "trainer.max_epochs must be a whole number or null, got many",
    "--model.gone=3": "model: Option 'gone' is not accepted",
    "--model.generator.init_args.code_dim=many": "model.generator.code_dim must be a whole number, got many",
    "--gone=3": "unrecognized arguments: --gone=3",
    "--data.batch_size=-3": "batch_size must be at least 1, got -3",
    "--data.category=dog": "category must be one of bottle, bowl, camera, can, laptop, mug, a .yaml file",
    "--trainer.accelerator=nope": "accelerator='nope'",
    "-c=gone.yaml": "File does not exist: ",
}


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:LightningCLI's args parameter")
@pytest.mark.parametrize("word", TREES)
def test_a_training_s_mistakes_are_reported_in_one_sentence(
    word: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["kfit"])
    monkeypatch.setattr(logging, "raiseExceptions", False)  # Lightning keeps the first test's stderr
    monkeypatch.setenv("JSONARGPARSE_DEPRECATION_WARNINGS", "off")
    with pytest.raises(SystemExit) as end:
        main(["fit", "-c", str(ROOT / "recipes/smoke.yaml"), word])
    out, err = capsys.readouterr()
    last = err.splitlines()[-1]  # Lightning tells its seed before
    assert end.value.code == 2
    assert (out, err.count("\n")) in (("", 1), ("", 2))
    assert last.startswith("kfit: ")
    assert TREES[word] in last
    assert not list(Path().iterdir())
