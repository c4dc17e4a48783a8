"""What all commands do alike: ``--quiet`` and ``--verbose``, notes on stderr, progress, tables, and how they end."""

from __future__ import annotations

import argparse
import importlib
import io
import logging
import os
import platform
import re
import sys
import time
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

from kfit import __version__
from kfit.runtime.own_part import own_part

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress

ENDINGS = """exit status:
  0    done
  1    unexpected error; --verbose shows where it happened
  2    wrong arguments or files; one sentence names them
  130  interrupted (Ctrl-C); files are complete or absent
  141  the reader of the output has stopped reading"""
# Errors of kfit about wrong arguments and files, and of libraries about the machine, such as exhausted memory.
MISTAKES = (ValueError, OSError, ImportError, RuntimeError, MemoryError)
log = logging.getLogger("kfit")


def add_general_options(parser: Any) -> None:
    """Add ``--quiet``, ``--verbose`` and ``--import`` to a parser of argparse's or jsonargparse's."""
    group = parser.add_argument_group("general options")
    # Absent by default, so that they are not part of the command line that a report repeats.
    settings: Any = {"action": "store_true", "default": argparse.SUPPRESS}
    group.add_argument("-q", "--quiet", help="errors only: no progress, no notes", **settings)
    group.add_argument("-v", "--verbose", help="more messages, and the traceback of an error", **settings)
    group.add_argument(
        "--import",
        dest="modules",
        action="append",
        metavar="MODULE",
        default=argparse.SUPPRESS,
        help="import a module first, such as one with your own parts for a recipe; can be repeated",
    )


@contextmanager
def session(args: Sequence[str] | None) -> Iterator[list[str]]:
    """Heed the general options wherever they stand, give the other words, and end with the right exit status.

    Meanwhile the level of the logger ``kfit`` is ERROR with ``--quiet``, DEBUG with ``--verbose``, else
    INFO; what is logged goes to stderr.

    Args:
        args: arguments after the program's name; by default those of the process.

    Raises:
        SystemExit: with one of `ENDINGS` unless all went well.
    """
    general = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    add_general_options(general)
    general_options, words = general.parse_known_args(list(sys.argv[1:] if args is None else args))
    quiet, verbose = "quiet" in general_options, "verbose" in general_options and "quiet" not in general_options
    handler, before = _Stderr(), log.level
    handler.setFormatter(logging.Formatter("kfit: %(message)s"))
    log.addHandler(handler)
    log.setLevel(logging.ERROR if quiet else logging.DEBUG if verbose else logging.INFO)
    try:
        with _writable(), _drawing_to_files(), _endings(verbose), warnings.catch_warnings():
            if quiet and "verbose" in general_options:
                raise ValueError("--quiet and --verbose were both given; use one of them")
            if quiet:
                warnings.simplefilter("ignore")
            begun = time.perf_counter()
            log.debug("%s, Python %s, %s: %s", __version__, platform.python_version(), platform.platform(), words)
            try:
                _import(getattr(general_options, "modules", []))
                yield words
            finally:
                _flush()
            log.debug("done in %.1f s", time.perf_counter() - begun)
    finally:
        log.removeHandler(handler)
        log.setLevel(before)


def progress() -> Progress:
    """Return a progress bar with the time left, on stderr; hidden if it is not a terminal, or with ``--quiet``."""
    from rich.console import Console
    from rich.progress import Progress

    silent = not sys.stderr.isatty() or not log.isEnabledFor(logging.WARNING)
    return Progress(console=Console(stderr=True), disable=silent, transient=True)


@contextmanager
def status(text: str) -> Iterator[None]:
    """A line that moves on stderr while something is done that has no steps; silent where `progress` is."""
    from rich.console import Console

    if not sys.stderr.isatty() or not log.isEnabledFor(logging.WARNING):
        yield
        return
    with Console(stderr=True, markup=False, emoji=False).status(text):
        yield


def table_console(width: int) -> Console:
    """Return the console of tables: as wide as the terminal, or of this width if stdout is not a terminal.

    It prints names and values as they are: text in brackets is no markup.
    """
    from rich.console import Console

    return Console(width=None if sys.stdout.isatty() else width, markup=False, emoji=False)


def see_working_folder() -> None:
    """Have parts that a recipe names found in files of the working folder, which a console script does not see."""
    if os.getcwd() not in sys.path:
        sys.path.append(os.getcwd())  # last, so that it can shadow nothing


def _import(modules: Sequence[str]) -> None:
    """Import modules, also those of the working folder.

    Raises:
        ValueError: for one that cannot be imported.
    """
    if modules:
        see_working_folder()
    for module in modules:
        try:
            importlib.import_module(module)
        except ImportError as error:
            raise ValueError(f"--import {module}: {error}") from error


class _Stderr(logging.Handler):
    """Writes to what `sys.stderr` is by then: while a bar is shown, a stream that writes above it."""

    def emit(self, record: logging.LogRecord) -> None:
        with suppress(OSError):  # if nothing can be written, the exit status remains
            print(_inert(self.format(record)), file=sys.stderr)


@contextmanager
def _writable() -> Iterator[None]:
    """Write characters that the encoding of stdout lacks as escapes, instead of failing."""
    out = sys.stdout
    if not isinstance(out, io.TextIOWrapper) or out.errors != "strict":
        yield
        return
    out.reconfigure(errors="backslashreplace")
    try:
        yield
    finally:
        if not out.closed:
            out.reconfigure(errors="strict")


@contextmanager
def _drawing_to_files() -> Iterator[None]:
    """Keep Matplotlib from the backend that the environment names: it is not needed, and may not be there."""
    before = os.environ.get("MPLBACKEND")
    os.environ["MPLBACKEND"] = "agg"
    try:
        yield
    finally:
        os.environ.pop("MPLBACKEND") if before is None else os.environ.update(MPLBACKEND=before)


def _flush() -> None:
    if sys.stdout is None:  # closed by whoever started this
        return
    try:
        sys.stdout.flush()
    except OSError as error:
        raise OSError(error.errno, error.strerror, "standard output") from None


def _inert(text: str) -> str:
    """The text with escapes for the characters that would steer a terminal, as strangers' files and names may hold."""
    return "".join(sign if sign == "\n" or sign.isprintable() else repr(sign)[1:-1] for sign in text)


@contextmanager
def _endings(verbose: bool) -> Iterator[None]:
    try:
        yield
    except BrokenPipeError:
        # Python flushes once more as it ends, and would complain.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise SystemExit(141) from None
    except KeyboardInterrupt:
        log.warning("interrupted")
        raise SystemExit(130) from None
    except SystemExit as end:
        # Lightning and rich turn these into an end with status 1.
        code = {KeyboardInterrupt: 130, BrokenPipeError: 141}.get(type(end.__context__), end.code)  # type: ignore[arg-type]
        raise SystemExit(code) from None
    except MISTAKES as error:
        log.error("%s", _on_one_line(error), exc_info=verbose)
        raise SystemExit(2) from None
    except Exception as error:
        # Lightning refuses wrong uses of its parts by an exception of its own.
        if type(error).__name__ == "MisconfigurationException":
            log.error("%s", _on_one_line(error), exc_info=verbose)
            raise SystemExit(2) from None
        advice = "" if verbose else "; the same command with --verbose shows where it happened"
        kind, reason, place = type(error).__name__, _on_one_line(error), own_part(error)
        if place is not None:
            log.error("%s: %s: %s%s", place, kind, reason, advice, exc_info=verbose)
            raise SystemExit(1) from None
        log.error(
            "unexpected %s: %s%s. This is a fault of kfit's: please report it to its authors with what --verbose shows",
            kind,
            reason,
            advice,
            exc_info=verbose,
        )
        raise SystemExit(1) from None


def _on_one_line(error: Exception) -> str:
    """Return the message of an error, or its type if it has none."""
    return " ".join(re.sub(r"^\[Errno \d+\] ", "", str(error)).split()) or type(error).__name__
