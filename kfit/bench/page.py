"""A benchmark's tables on the terminal, and on a page in Markdown."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from kfit.bench.accuracy import write_text
from kfit.bench.accuracy_page import Section, circumstances
from kfit.runtime.console import log, table_console


@contextmanager
def lightning_silent() -> Iterator[None]:
    """Silence Lightning except for warnings."""
    lightning = logging.getLogger("lightning.pytorch")
    before = lightning.level
    lightning.setLevel(max(before, logging.WARNING))
    try:
        yield
    finally:
        lightning.setLevel(before)


def show(tables: Sequence[Section], width: int) -> None:
    """Print tables, each with its notes."""

    for table in tables:
        table_console(width).print(table.table())
        print("\n".join(table.notes))


def write_page(
    out: str,
    title: str,
    command: str,
    tables: Sequence[Section],
    lines: Sequence[str] = (),
    files: Mapping[str, Callable[[Path], object]] | None = None,
) -> None:
    """Write README.md: title, command, machine, introductory lines and tables.

    Args:
        out: Folder of the page.
        title: Title of the page.
        command: Command that repeats the measurement.
        tables: Tables, in order.
        lines: Lines above the tables.
        files: Functions that write further files into the folder, by file name.
    """
    from kfit.runtime.atomic_write import atomic_write

    how = circumstances(command, {})
    machine, versions = how["machine"], ", ".join(f"{name} {number}" for name, number in how["versions"].items())
    head = f"Made by `{command}`; {versions}; {machine['processor']}, {machine['threads']} threads."
    text = "\n".join([f"# {title}", "", head, "", *lines, *(line for table in tables for line in table.markdown())])
    for path in atomic_write(Path(out), {"README.md": partial(write_text, text=text), **(files or {})}):
        log.info("wrote %s", path)
