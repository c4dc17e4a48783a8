"""The command line: ``kfit pose``, ``evaluate``, ``pack``, ``calibrate``, ``export``, ``bench`` and Lightning's own."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence

from jsonargparse import ArgumentParser, Namespace

from kfit import __version__
from kfit.cli import app, bench, calibrate, evaluate, export, pack, pose

TRAINING = ("fit", "validate", "test", "predict")
COMMANDS = {
    "pose": pose,
    "app": app,
    "evaluate": evaluate,
    "pack": pack,
    "calibrate": calibrate,
    "export": export,
    "bench": bench,
}


def parser() -> ArgumentParser:
    """The parser of all commands but Lightning's."""
    top = ArgumentParser(
        prog="kfit",
        version=__version__,
        description="Fit a picture: find pose, shape and look of an object by drawing it until the drawing explains "
        "the photo.",
        epilog=f"Training: kfit {{{','.join(TRAINING)}}} -c recipes/vae3d.yaml, the same as `lightning`.",
    )
    commands = top.add_subcommands(metavar="COMMAND", help="what to do; `kfit COMMAND --help` tells more")
    parsers = {name: command.parser() for name, command in COMMANDS.items()}
    for name, command in COMMANDS.items():
        commands.add_subcommand(name, parsers[name], help=str(command.__doc__).partition("\n")[0])
    bench.add_benchmarks(parsers["bench"])
    return top


def main(args: Sequence[str] | None = None) -> None:
    """Run a command; a user's mistake ends in one sentence on stderr and exit status 2.

    Args:
        args: words after the program's name; those of the process unless given.
    """
    words = list(sys.argv[1:] if args is None else args)
    try:
        if words and words[0] in TRAINING:
            from kfit.cli import lightning

            lightning.main(words)
            return
        said = parser().parse_args(words)
        chosen: Namespace = said[said.subcommand]
        COMMANDS[said.subcommand].run(chosen)
    except (ValueError, TypeError, OSError, RuntimeError, ImportError) as error:
        if os.environ.get("KFIT_DEBUG"):
            raise
        print(f"kfit: {error}", file=sys.stderr)
        raise SystemExit(2) from None
