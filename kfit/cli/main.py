"""The command line: ``kfit pose``, ``video``, ``evaluate`` and the other commands, and Lightning's own."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from jsonargparse import ArgumentError, ArgumentParser, Namespace

from kfit import __version__
from kfit.cli import app, bench, calibrate, completion, evaluate, export, info, pack, pose, video
from kfit.cli.help_page import HelpPage
from kfit.cli.session import ENDINGS, add_general_options, session

TRAINING = {
    "fit": "Train networks as a recipe says, by Lightning.",
    "validate": "Measure trained networks on a recipe's validation data.",
    "test": "Measure trained networks on a recipe's test data.",
    "predict": "Fit a whole data set as a recipe says.",
}
COMMANDS = {
    "pose": pose,
    "video": video,
    "app": app,
    "evaluate": evaluate,
    "pack": pack,
    "calibrate": calibrate,
    "export": export,
    "bench": bench,
    "info": info,
    "completion": completion,
}
EXAMPLES = """examples:
  kfit pose photo.jpg --category mug --box 120 80 300 260
  kfit fit -c recipes/smoke.yaml
  kfit info

"""


def parser() -> ArgumentParser:
    """The parser of all commands; of Lightning's, which read recipes, it knows the names."""
    top = ArgumentParser(
        prog="kfit",
        version=__version__,
        description="Fit a picture: find pose, shape and look of an object by drawing it until the drawing explains "
        "the photo. `kfit COMMAND --help` tells more of a command.",
        epilog=f"{EXAMPLES}{ENDINGS}\n\nAnswers, tables and JSON go to stdout, all else to stderr. Tab completion: see "
        "`kfit completion --help`.",
        formatter_class=HelpPage,
        exit_on_error=False,
    )
    commands = top.add_subcommands(title="commands", description=None, metavar="COMMAND")
    parsers = {name: command.parser() for name, command in COMMANDS.items()}
    for name, command in COMMANDS.items():
        commands.add_subcommand(name, parsers[name], help=str(command.__doc__).partition("\n")[0])
    bench.add_benchmarks(parsers["bench"])
    for name, told in TRAINING.items():
        training = ArgumentParser()
        training.add_argument("-c", "--config", type=str, default=None, metavar="RECIPE.yaml", help="the recipe")
        commands.add_subcommand(name, training, help=told)
    for one in tree(top):
        add_general_options(one)
    return top


def tree(parser: ArgumentParser) -> Iterator[ArgumentParser]:
    """A parser, and those of its commands and of theirs."""
    yield parser
    if parser._subcommands_action is not None:
        for below in parser._subcommands_action.choices.values():
            yield from tree(below)


def main(args: Sequence[str] | None = None) -> None:
    """Run a command; without one, show the help. `kfit.cli.session.ENDINGS` tells how it ends.

    Args:
        args: words after the program's name; those of the process unless given.
    """
    with session(args) as words:
        if words and words[0] in TRAINING:
            from kfit.cli import lightning

            lightning.run(words)
            return
        if words in ([], ["bench"]):
            words.append("--help")
        try:
            said = parser().parse_args(words)
        except ArgumentError as error:
            named = [word for word, known in zip(words, (COMMANDS, bench.BENCHMARKS), strict=False) if word in known]
            told = " ".join(str(error).split())  # jsonargparse breaks its lines
            raise ValueError(f"{told}; `{' '.join(['kfit', *named])} --help` tells more") from None
        chosen: Namespace = said[said.subcommand]
        COMMANDS[said.subcommand].run(chosen)
