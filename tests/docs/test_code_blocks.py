"""What the pages tell a reader to type: Python runs, and the words of a command are ones that the command knows.

The blocks of a page run in order, in one namespace and one folder. Where a page takes a reader's own photo, video or
meshes for granted, the stand-ins below are there. A block of Python that begins with ``# name.py`` and one of YAML that
begins with ``# name.yaml`` are saved under that name too. After a comment ``<!-- run -->``, which a reader does not
see, a block of commands runs; the words of all other commands are parsed.
"""

from __future__ import annotations

import io
import re
import shlex
import shutil
import subprocess
import sys
import warnings
from collections.abc import Iterator
from contextlib import redirect_stdout
from dataclasses import dataclass
from itertools import dropwhile, groupby
from pathlib import Path

import pytest
import yaml
from jsonargparse import ArgumentError
from markdown_it import MarkdownIt
from skimage import data
from skimage.io import imread, imsave

from kfit.cli.main import TRAINING, parser
from kfit.training import lightning_cli as training

ROOT = Path(__file__).parents[2]
MASK = imread(ROOT / "examples" / "coffee_mask.png")
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *sorted(page for page in (ROOT / "docs").rglob("*.md") if "_build" not in page.parts),
]


@dataclass
class Block:
    """A fenced block: its language, text and line, and the invisible comment before it."""

    language: str
    text: str
    line: int
    marker: str


def blocks_of(text: str) -> list[Block]:
    found, marker = [], ""
    for token in MarkdownIt().parse(text):
        if token.type == "fence" and not token.info.startswith("{"):
            found.append(Block(token.info.strip(), token.content, token.map[0] + 1, marker))
        marker = token.content.strip(" \n<>!-") if token.type == "html_block" else ""
    return found


WITH_BLOCKS = [page for page in PAGES if blocks_of(page.read_text())]


def name_of(page: Path) -> str:
    return str(page.relative_to(ROOT))


def commands_of(text: str) -> list[list[str]]:
    """Words of each command, without comments, prompts and variables set before it."""
    found = []
    for line in text.replace("\\\n", " ").splitlines():
        words = shlex.split(line.removeprefix("$ "), comments=True)
        for joined, group in groupby(words, "&&".__eq__):
            command = list(dropwhile(lambda word: re.match(r"\w+=|srun$", word), group))
            if command and not joined:
                found.append(command)
    return found


def kfit_words(words: list[str]) -> list[str] | None:
    """What a command hands to kfit, or None if it is another program."""
    program, others = Path(words[0]).name, words[1:]
    if program in ("kfit", "lightning"):
        return others
    if program.startswith("python") and others[:2] == ["-m", "kfit"]:
        return others[2:]
    if program.startswith("python") and others[:1] == ["-c"] and "kfit.cli.main" in others[1]:
        return others[2:]
    return None


class _ParsedError(Exception):
    """Raised where Lightning's command line would go on to build what it was told."""


def check(words: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Have the real parser read the words, and nothing built or run."""

    def stop(self: object) -> None:
        raise _ParsedError

    if words[0] in TRAINING:
        monkeypatch.setattr(training._CLI, "before_instantiate_classes", stop)
        monkeypatch.setattr(sys, "argv", ["lightning", *words])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of jsonargparse about Lightning
            with pytest.raises(_ParsedError):
                training.run(words)
    else:
        parser().parse_args(words)


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A photo, its mask and a mesh, as a reader's own."""
    folder = tmp_path_factory.mktemp("files")
    imsave(folder / "photo.png", data.coffee())
    imsave(folder / "photo.jpg", data.coffee())
    imsave(folder / "mask.png", MASK, check_contrast=False)
    (folder / "meshes").mkdir()
    (folder / "meshes" / "slab.obj").write_text("v 0 0 0\nv 1 0 0\nv 1 2 0\nv 0 2 0.5\nf 1 2 3\nf 1 3 4\n")
    return folder


@pytest.fixture
def place(files: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Where a reader may be: a clone of the repository, with files of their own."""
    for name in ("examples", "recipes"):
        (tmp_path / name).symlink_to(ROOT / name)
    shutil.copytree(files, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    before = set(sys.modules)
    yield tmp_path
    for name in set(sys.modules) - before:
        if getattr(sys.modules[name], "__file__", None) and str(tmp_path) in str(sys.modules[name].__file__):
            del sys.modules[name]


@pytest.mark.slow
@pytest.mark.filterwarnings(r"ignore:`isinstance\(treespec, LeafSpec\)` is deprecated:FutureWarning")  # Lightning's
@pytest.mark.parametrize("page", WITH_BLOCKS, ids=name_of)
def test_what_a_page_tells_to_type_works(page: Path, place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    names: dict[str, object] = {"frames": [data.coffee()] * 2, "first_mask": MASK}  # as a reader's own
    for block in blocks_of(page.read_text()):
        where = f"{name_of(page)}:{block.line}"
        file = re.match(r"# (\w+\.(?:py|yaml))\n", block.text)
        if file:
            (place / file[1]).write_text(block.text)
        if block.language == "python":
            with redirect_stdout(io.StringIO()):
                exec(compile("\n" * block.line + block.text, name_of(page), "exec"), names)
        elif block.language == "yaml":
            yaml.safe_load(block.text)
        elif block.language in ("console", "sh"):
            for command in commands_of(block.text):
                words = kfit_words(command)
                if words is None:
                    scripts = [word for word in command[1:] if word.startswith("examples/") and word.endswith(".py")]
                    assert all((ROOT / script).is_file() for script in scripts), f"{where}: no {scripts}"
                    continue
                try:
                    with monkeypatch.context() as patch:
                        check(words, patch)
                except SystemExit:
                    pytest.fail(f"{where}: the parser refuses: kfit {shlex.join(words)}")
                if block.marker == "run":
                    done = subprocess.run([sys.executable, "-m", "kfit", *words], capture_output=True, text=True)
                    assert done.returncode == 0, f"{where}: {done.stderr}"


@pytest.mark.parametrize("words", ["pose photo.jpg --kind mug", "fit -c recipes/smoke.yaml --model.hue 1"])
def test_words_that_no_command_knows_are_refused(words: str, place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises((ValueError, ArgumentError)):
        check(words.split(), monkeypatch)
