"""The directive ``command-help``: what each command of kfit says of itself, asked of its parser."""

from __future__ import annotations

import re
from argparse import ArgumentParser
from collections.abc import Iterator

from docutils import nodes
from docutils.parsers.rst import Directive
from sphinx.application import Sphinx


class CommandHelp(Directive):
    """A section for each command, with the text of its ``--help``."""

    def run(self) -> list[nodes.Node]:
        from kfit.cli.main import parser

        return [_section(name, text) for name, text in helps(parser())]


def helps(parser: ArgumentParser) -> Iterator[tuple[str, str]]:
    """Names and help of a command and of those below it."""
    # jsonargparse shows a choice's type as the address of a function, another one each time.
    text = re.sub(r"type:\s+<function[^,]*,\s+", "", parser.format_help())
    yield parser.prog.replace(" [options]", ""), text
    for below in parser._subparsers._group_actions if parser._subparsers else []:
        for one in below.choices.values():  # type: ignore[union-attr]
            yield from helps(one)


def _section(name: str, text: str) -> nodes.section:
    section = nodes.section(ids=[nodes.make_id(name)], names=[name])
    section += nodes.title(text=name)
    section += nodes.literal_block(text, text, language="text")
    return section


def setup(app: Sphinx) -> dict[str, bool]:
    """Called by Sphinx."""
    app.add_directive("command-help", CommandHelp)
    return {"parallel_read_safe": True}
