"""What ``--help`` promises, of every command and benchmark."""

import argparse
import functools
import shlex

import pytest

from kfit.bench.command import BENCHMARKS
from kfit.cli import main as command_line
from kfit.cli.main import COMMANDS, TRAINING, main
from kfit.runtime.parser_parts import tree

NAMES = ["", *COMMANDS, *(f"bench {name}" for name in BENCHMARKS)]
parser = functools.cache(command_line.parser)
GENERAL = {"-h", "-q", "-v", "--version", "--import"}


@pytest.fixture(autouse=True)
def parser_built_once(monkeypatch):
    monkeypatch.setattr(command_line, "parser", parser)


def page_of(name, capsys):
    with pytest.raises(SystemExit) as ended:
        main([*name.split(), "--help"])
    assert not ended.value.code
    return capsys.readouterr().out


def parser_of(name):
    found = parser()
    for word in name.split():
        found = found._subcommands_action.choices[word]
    return found


def examples_of(text):
    return [line[2:] for line in text.splitlines() if line.startswith("  kfit ")]


@pytest.mark.parametrize("name", NAMES)
def test_every_option_tells_its_default_and_every_argument_what_it_means(name, capsys):
    actions = [one for one in parser_of(name)._actions if not isinstance(one, argparse._SubParsersAction)]
    assert all(one.help for one in actions)
    options = [one for one in actions if one.option_strings and not GENERAL & set(one.option_strings)]
    with_default = [one for one in options if one.required or one.default is not None or "(default: " in one.help]
    text = " ".join(page_of(name, capsys).split())
    assert text.count("(default: ") + text.count("(required)") == len(with_default)
    assert "(default: none)" not in text
    assert "null" not in text
    assert "type:" not in text


@pytest.mark.parametrize("name", NAMES)
def test_a_page_has_examples_on_lines_of_their_own_that_are_accepted(name, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "50")
    examples = examples_of(page_of(name, capsys))
    assert examples
    assert any(example.startswith(f"kfit {name}".strip()) for example in examples)
    for example in examples:
        parser().parse_args(shlex.split(example.partition(" > ")[0])[1:])


@pytest.mark.parametrize("name", NAMES)
def test_the_usage_is_a_line(name, capsys):
    usage, empty, *_ = page_of(name, capsys).splitlines()
    assert usage.startswith(f"usage: kfit {name}".strip())
    assert "[OPTIONS]" in usage
    assert not empty


def test_kfit_alone_shows_all_commands_and_exit_statuses(capsys):
    with pytest.raises(SystemExit) as ended:
        main([])
    assert not ended.value.code
    page = capsys.readouterr().out
    for name in (*COMMANDS, *TRAINING):
        assert f"\n    {name} " in page
    for status in ("0", "1", "2", "130", "141"):
        assert f"\n  {status} " in page


def test_kfit_bench_alone_shows_all_benchmarks(capsys):
    with pytest.raises(SystemExit):
        main(["bench"])
    page = capsys.readouterr().out
    assert all(f"\n    {name} " in page for name in BENCHMARKS)


def test_every_command_shows_the_general_options(capsys):
    for part in tree(parser()):
        assert {"--quiet", "--verbose"} <= set(part._option_string_actions)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([*["pose", "--category", "mug"]], "pose.photo; `kfit pose --help` shows the usage"),
        (["nonsense"], "invalid choice: 'nonsense'"),
        ([*["bench", "accuracy", "--views", "many"]], "`kfit bench accuracy --help` shows the usage"),
        ([*["bench", "nonsense"]], "`kfit bench --help` shows the usage"),
        (["info", "--nonsense"], "unrecognized arguments: --nonsense; `kfit info --help` shows the usage"),
        (["poes", "a.jpg"], "did you mean pose? `kfit --help` shows the usage"),
        (["pose", "a.jpg", "--catgory", "mug"], "--catgory mug; did you mean --category? `kfit pose --help` shows"),
        (["bench", "acuracy"], "did you mean accuracy? `kfit bench --help` shows the usage"),
        (["fitt", "-c", "recipe.yaml"], "did you mean fit? `kfit --help` shows the usage"),
        (["fit", "--modle.hue", "1"], "--modle.hue 1; did you mean --model? `kfit fit --help` shows the usage"),
    ],
)
def test_wrong_words_get_one_sentence_that_names_the_page(words, message, capsys):
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code == 2
    out, err = capsys.readouterr()
    assert not out
    assert err.startswith("kfit: ")
    assert message in err
    assert len(err.splitlines()) == 1
