"""The command line: ``kfit pose``, ``video``, ``evaluate`` and the other commands, and Lightning's own."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from jsonargparse import ArgumentError, ArgumentParser, Namespace

from kfit import __version__
from kfit.bench import calibrate
from kfit.bench import command as bench
from kfit.cli import app, compare, completion, demo, evaluate, export, info, pack, pose, video, views
from kfit.runtime.console import ENDINGS, add_general_options, session
from kfit.runtime.did_you_mean import suggestion
from kfit.runtime.help_page import HelpPage
from kfit.runtime.parse_errors import sentence
from kfit.runtime.parser_parts import options_of, tree

TRAINING = {
    "fit": "Train networks by a recipe, with Lightning.",
    "validate": "Measure trained networks on a recipe's validation data.",
    "test": "Measure trained networks on a recipe's test data.",
    "predict": "Fit a data set by a recipe.",
}
COMMANDS = {
    "demo": demo,
    "pose": pose,
    "video": video,
    "app": app,
    "evaluate": evaluate,
    "views": views,
    "compare": compare,
    "pack": pack,
    "calibrate": calibrate,
    "export": export,
    "bench": bench,
    "info": info,
    "completion": completion,
}
MOST = 10**9
EXAMPLES = """examples:
  kfit demo
  kfit pose photo.jpg --open
  kfit fit -c recipes/smoke.yaml
  kfit info

"""


def parser() -> ArgumentParser:
    """The parser of all commands; of Lightning's, which read recipes, it knows the names."""
    top = ArgumentParser(
        prog="kfit",
        version=__version__,
        description="Fit a picture: find pose, shape and appearance of an object by drawing it until the drawing "
        "explains the photo. `kfit COMMAND --help` describes a command.",
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
    for name, summary in TRAINING.items():
        training = ArgumentParser()
        training.add_argument("-c", "--config", type=str, default=None, metavar="RECIPE.yaml", help="the recipe")
        commands.add_subcommand(name, training, help=summary)
    for one in tree(top):
        add_general_options(one)
        one.allow_abbrev = False  # jsonargparse would accept and deprecate them
    return top


def check_numbers(arguments: Namespace) -> None:
    """Refuse numbers that are infinite or NaN, which YAML spells .inf and .nan, and counts and seeds out of all range.

    Raises:
        ValueError: naming the option.
    """
    for name, value in arguments.items():
        option = f"--{name.replace('_', '-')}"
        for number in _flat(value):
            if isinstance(number, float) and not math.isfinite(number):
                raise ValueError(f"{option} must be finite, got {number}")
            if name == "seed" and not 0 <= number < 2**63:
                raise ValueError(f"{option} must lie between 0 and 2^63 - 1, got {number}")
            if name != "seed" and isinstance(number, int) and abs(number) > MOST:
                raise ValueError(f"{option} must be at most {MOST:,}, got {number:,}")


def _flat(value: Any) -> Iterator[Any]:
    if isinstance(value, list):
        for part in value:
            yield from _flat(part)
    else:
        yield value


def check_places(arguments: Namespace) -> None:
    """Refuse places to write to that cannot be written to, before any work is done.

    Raises:
        ValueError, OSError: naming the option.
    """
    for name in ("out", "runs", "cache", "report", "animation", "mesh"):
        if (place := arguments.get(name)) is None:
            continue
        if not place:
            raise ValueError(f"--{name} must name a place to write to, got ''")
        from kfit.runtime.atomic_write import check_folder

        path = Path(place)
        is_file = name in ("report", "animation", "mesh") or path.suffix == ".safetensors"
        check_folder(f"--{name}", path.parent if is_file else path)
        if is_file and path.is_dir():
            raise ValueError(f"--{name} must name a file, but {path} is a folder")


def main(args: Sequence[str] | None = None) -> None:
    """Run a command; without one, show the help. `kfit.runtime.console.ENDINGS` lists its exit codes.

    Args:
        args: arguments after the program's name; by default those of the process.
    """
    with session(args) as words:
        if words and words[0] in TRAINING:
            from kfit.training import lightning_cli as lightning

            lightning.run(words)
            return
        if words in ([], ["bench"]):
            words.append("--help")
        try:
            arguments = (top := parser()).parse_args(words)
        except ArgumentError as error:
            named = [word for word, known in zip(words, (COMMANDS, bench.BENCHMARKS), strict=False) if word in known]
            message = sentence(str(error))
            key = message.partition(" ")[0].replace("_", "-")
            option = any(f"--{key}" in options_of(part) for part in tree(top))
            reason = f"--{key}{message[len(key) :]}" if option else message
            raise ValueError(
                f"{reason};{suggestion(words, top, TRAINING)} `{' '.join(['kfit', *named])} --help` shows the usage"
            ) from None
        chosen: Namespace = arguments[arguments.subcommand]
        values = chosen[chosen.subcommand] if "subcommand" in chosen else chosen
        check_numbers(values)
        check_places(values)
        if arguments.subcommand == "completion":
            completion.run(chosen, top)
        else:
            COMMANDS[arguments.subcommand].run(chosen)
