"""Suggestions for misspelt words of the command line."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from difflib import get_close_matches

from jsonargparse import ArgumentParser

from kfit.runtime.parser_parts import commands_of, options_of


def suggestion(words: Sequence[str], top: ArgumentParser, others: Iterable[str] = ()) -> str:
    """Return " did you mean …?" for the first word that is no command or option where it stands, else "".

    Args:
        words: words of the command line.
        top: the parser of all commands.
        others: commands that it leaves to other parsers.
    """
    here, known = top, set(others)
    for word in words:
        commands = commands_of(here)
        if word in commands:
            here, known = commands[word], set()
            continue
        if word.startswith("--"):
            name, options = word.partition("=")[0], {name for name in options_of(here) if name[-1] != "+"}
            if name not in options:
                return near(name, options)
        elif commands:
            return near(word, {*commands, *known})
    return ""


def option_suggestion(message: str, words: Sequence[str], top: ArgumentParser) -> str:
    """Return " did you mean …?" for the option that the message of a parser calls unrecognized, else ""."""
    if not message.startswith("unrecognized arguments: --"):
        return ""
    here = top
    for command in words:
        here = commands_of(here).get(command, here)
    options = options_of(here)
    word = message.split()[2].partition("=")[0]
    first, firsts = word.partition(".")[0], {option.partition(".")[0] for option in options}
    if first not in firsts:
        return near(first, firsts)
    return near(word, {option for option in options if not option.endswith(("+", ".help"))})


def near(word: str, known: Iterable[str]) -> str:
    """Return " did you mean …?" with the known word that is most like this one, or "" where none is."""
    found = get_close_matches(word, sorted(known), n=1, cutoff=0.6)
    return f" did you mean {found[0]}?" if found else ""
