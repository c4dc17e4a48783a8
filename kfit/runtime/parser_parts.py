"""The commands and options of a parser, for which argparse and jsonargparse have no public list."""

from __future__ import annotations

import argparse
from collections.abc import Iterator

from jsonargparse import ArgumentParser


def commands_of(parser: ArgumentParser) -> dict[str, ArgumentParser]:
    """Return the parsers of a parser's commands by name, none where it has no commands."""
    return {} if parser._subcommands_action is None else parser._subcommands_action.choices


def tree(parser: ArgumentParser) -> Iterator[ArgumentParser]:
    """Yield a parser, and those of its commands and of theirs."""
    yield parser
    for below in commands_of(parser).values():
        yield from tree(below)


def arguments_of(parser: ArgumentParser) -> list[argparse.Action]:
    """Return a parser's options and positional arguments."""
    return parser._actions


def options_of(parser: ArgumentParser) -> set[str]:
    """Return the names of a parser's options, such as ``--out``; those that append to a list end with ``+``."""
    return {name for action in arguments_of(parser) for name in action.option_strings}
