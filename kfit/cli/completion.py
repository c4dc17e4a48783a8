"""Print a script with which a shell completes kfit's commands, options and files."""

from __future__ import annotations

import argparse
from typing import Literal

from jsonargparse import ArgumentParser, Namespace

from kfit.cli import info
from kfit.cli.photo_files import path_name
from kfit.runtime.parser_parts import arguments_of, tree

SHELLS = Literal["bash", "zsh", "fish"]


def parser() -> ArgumentParser:
    """Arguments of ``kfit completion``."""
    parser = ArgumentParser(
        description="Print a script with which a shell completes kfit's commands, options and their files. "
        "Let your shell read it at its start:",
        epilog="""bash, a line of ~/.bashrc:
  eval "$(kfit completion bash)"

zsh, lines of ~/.zshrc:
  autoload -Uz compinit && compinit
  eval "$(kfit completion zsh)"

fish, once:
  kfit completion fish > ~/.config/fish/completions/kfit.fish

example:
  kfit completion bash""",
    )
    parser.add_argument("shell", type=SHELLS, help="bash, zsh or fish")
    return parser


def run(args: Namespace, whole: ArgumentParser) -> None:
    """Print the script for the parser of all commands."""
    for part in tree(whole):
        for action in arguments_of(part):
            _complete_words(action)
    print(whole.get_completion_script(f"shtab-{args.shell}"))


def _complete_words(action: argparse.Action) -> None:
    """Complete arguments by names of files, or of folders, like the shell's default completion."""
    import shtab

    if action.dest == "category":
        action.choices = sorted(path.stem for path in info.BUNDLED.glob("*.safetensors"))
    elif getattr(action, "_typehint", action.type) in (str, path_name) and action.choices is None:
        action.complete = shtab.DIRECTORY if action.metavar in ("DIR", "FOLDER") else shtab.FILE  # type: ignore[attr-defined]
