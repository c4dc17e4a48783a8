"""Recipes are measured before they are read: a few lines of YAML can stand for more than any memory holds."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from traceback import walk_tb

import yaml  # type: ignore[import-untyped]

# Bytes, values with all that aliases repeat, and levels; kfit's own recipes have a hundredth.
LARGEST, MOST_VALUES, DEEPEST = 200_000, 20_000, 30


@contextmanager
def no_exit() -> Iterator[None]:
    """Turn an exit that an imported module requests into an error.

    Raises:
        ValueError: where SystemExit was raised by other code than that which parses arguments.
    """
    try:
        yield
    except SystemExit as end:
        *_, (frame, _) = walk_tb(end.__traceback__)
        module = str(frame.f_globals.get("__name__"))
        if module.partition(".")[0] in ("argparse", "jsonargparse"):  # such as after --help
            raise
        raise ValueError(f"module {module} ends the program when it is imported (sys.exit({end.code!r}))") from None


def check_recipe(path: str | Path) -> None:
    """Refuse a recipe that is far larger than any.

    Raises:
        ValueError: if the file has more than 200,000 bytes, or its values are more than 20,000 or nested more than 30
            deep, those that aliases (``*name``) repeat counted each time.
    """
    path = Path(path)
    if (size := path.stat().st_size) > LARGEST:
        raise ValueError(f"{path} is no recipe: it has {size:,} bytes, more than {LARGEST:,}")
    try:
        root = yaml.compose(path.read_text(encoding="utf-8"), yaml.SafeLoader)
    except RecursionError:
        raise ValueError(f"{path} is no recipe: its values are nested too deeply") from None
    except (yaml.YAMLError, ValueError):
        return  # the reader reports its error
    values = 0 if root is None else _count(root, {}, 0)
    if values > MOST_VALUES:
        raise ValueError(
            f"{path} is no recipe: its aliases make more than {MOST_VALUES:,} values of it, or nest them more than "
            f"{DEEPEST} deep"
        )


def _count(node: yaml.Node, known: dict[int, int], depth: int) -> int:
    """Values below a node; more than allowed where they are nested too deeply, as in a list that holds itself."""
    if depth > DEEPEST:
        return MOST_VALUES + 1
    if id(node) not in known:
        below: list[yaml.Node] = []
        if isinstance(node, yaml.SequenceNode):
            below = node.value
        elif isinstance(node, yaml.MappingNode):
            below = [part for pair in node.value for part in pair]
        known[id(node)] = 1 + sum(_count(part, known, depth + 1) for part in below)
    return known[id(node)]
