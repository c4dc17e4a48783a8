"""Layout of ``--help``: a short usage line, examples on separate lines, and a default for every option."""

from __future__ import annotations

import argparse
import textwrap
from collections.abc import Iterable
from typing import Any

from jsonargparse import DefaultHelpFormatter

FLAGS = {"false": "no", "true": "yes"}


class HelpPage(DefaultHelpFormatter):
    """jsonargparse's page, for readers who do not know Python.

    Text is wrapped by paragraphs, and lines that begin with two spaces stay as they are. A default that an option's
    help does not name is added to it in parentheses.
    """

    def __init__(self, prog: str, *args: Any, **kwargs: Any) -> None:
        super().__init__(prog.replace(" [options]", ""), *args, **kwargs)

    def add_usage(self, usage: str | None, actions: Iterable[argparse.Action], *args: Any, **kwargs: Any) -> None:
        """Name required arguments in the usage line; the options are listed below."""
        needed = [action for action in actions if action.required or not action.option_strings]
        super().add_usage(usage, needed, *args, **kwargs)

    def _format_usage(self, usage: str | None, actions: Any, groups: Any, prefix: str | None) -> str:
        line = super()._format_usage(usage, actions, groups, prefix)
        # Without a prefix it is what names of commands are put together from.
        return line if prefix == "" or usage else line.replace(self._prog, f"{self._prog} [OPTIONS]", 1)

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        lines: list[str] = []
        paragraph: list[str] = []
        for line in [*text.splitlines(), ""]:
            if line.strip() and not line.startswith("  "):
                paragraph.append(line)
                continue
            lines += textwrap.wrap(" ".join(paragraph), width)
            paragraph = []
            lines.append(line)
        return "\n".join(f"{indent}{line}" for line in lines[:-1])

    def _format_action(self, action: argparse.Action) -> str:
        if isinstance(action.choices, dict):  # of commands, of which the list suffices
            return "".join(self._format_action(command) for command in self._iter_indented_subactions(action))
        return super()._format_action(action)

    def _format_action_invocation(self, action: argparse.Action) -> str:
        if not action.option_strings:
            return super()._format_action_invocation(action)
        names = ", ".join(name for name in action.option_strings if not name.endswith("+"))
        if action.nargs == 0:
            return names
        return f"{names} {self._format_args(action, self._get_default_metavar_for_optional(action))}"

    def _get_default_metavar_for_optional(self, action: argparse.Action) -> str:
        kind = getattr(action, "_typehint", action.type)
        return {int: "N", float: "X"}.get(kind, action.dest.upper())  # type: ignore[arg-type]

    def _get_help_string(self, action: argparse.Action) -> str:
        text = action.help or ""
        if "--help" in action.option_strings:
            return "show this help and exit"
        if "--version" in action.option_strings:
            return "show the version and exit"
        if not action.option_strings or action.default == argparse.SUPPRESS or "default" in text:
            return text
        if action.required:
            return f"{text} (required)"
        if action.default is None:
            return text
        default = _spelled(action.default)
        return f"{text} (default: {FLAGS[default] if action.nargs == 0 else default})"


def _spelled(default: object) -> str:
    """Return a default as it is written on the command line."""
    if isinstance(default, bool):
        return str(default).lower()
    if isinstance(default, list):
        return f"[{','.join(map(str, default))}]"
    return str(default)
