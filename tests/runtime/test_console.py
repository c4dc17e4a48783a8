"""Quiet, verbose, notes, progress, and how commands end."""

import importlib
import io
import logging
import os
import re
import signal
import subprocess
import sys
import warnings

import pytest

from kfit.cli import info
from kfit.cli.main import main
from kfit.runtime.console import log, progress, session, table_console


@pytest.fixture
def command(monkeypatch):
    """Has `kfit info` do something else."""
    return lambda run: monkeypatch.setattr(info, "run", run)


def raising(error):
    # As if kfit's own file raised it.
    names = {"error": error}
    exec(compile("def run(args): raise error", info.__file__, "exec"), names)
    return names["run"]


def ended(words):
    with pytest.raises(SystemExit) as end:
        main(words)
    return end.value.code


@pytest.mark.parametrize(
    ("error", "status"),
    [
        (ValueError("wrong"), 2),
        (FileNotFoundError("wrong"), 2),
        (ImportError("wrong"), 2),
        (RuntimeError("wrong"), 2),
        (TypeError("wrong"), 1),
        (KeyError("wrong"), 1),
        (AssertionError("wrong"), 1),
        (SystemExit(7), 7),
        (KeyboardInterrupt(), 130),
    ],
)
def test_how_a_command_ends_tells_what_went_wrong(error, status, command, capsys):
    command(raising(error))
    assert ended(["info"]) == status
    out, err = capsys.readouterr()
    assert not out
    assert "Traceback" not in err
    assert ("wrong" in err) == (status in (1, 2))
    assert ("fault of kfit's" in err) == (status == 1)
    assert ("--verbose" in err) == (status == 1)
    assert len(err.splitlines()) <= 1


def test_a_function_of_one_s_own_with_another_signature_is_no_fault_of_kfit_s(command, capsys, tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "own_watch.py").write_text("class Watch:\n    def on_start(self):\n        pass\n")
    own_watch = importlib.import_module("own_watch")
    names = {"watch": own_watch.Watch()}
    exec(compile("def run(args): watch.on_start(1)", info.__file__, "exec"), names)
    command(names["run"])
    assert ended(["info"]) == 1
    err = capsys.readouterr().err
    assert "own_watch.py, Watch.on_start: TypeError: Watch.on_start() takes 1 positional argument but 2" in err
    assert "fault of kfit's" not in err


@pytest.mark.parametrize("error", [ValueError("wrong"), KeyError("wrong")])
@pytest.mark.parametrize("words", [["--verbose", "info"], ["info", "-v"]])
def test_verbose_shows_where_an_error_came_from_and_what_was_asked(error, words, command, capsys):
    command(raising(error))
    ended(words)
    err = capsys.readouterr().err
    assert "Traceback" in err
    assert "in run" in err
    assert "['info']" in err


def test_an_interrupt_that_lightning_took_for_its_own_is_one(command):
    def run(args):
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt:
            sys.exit(1)

    command(run)
    assert ended(["info"]) == 130


def talkative(args):
    print("answer")
    log.info("note")
    log.warning("warning")
    warnings.warn("careful", stacklevel=1)


@pytest.mark.parametrize("words", [["-q", "info"], ["info", "--quiet"]])
def test_quiet_is_quiet_before_and_behind_the_command(words, command, capsys):
    command(talkative)
    main(words)
    assert capsys.readouterr() == ("answer\n", "")


def test_errors_are_reported_also_quietly(command, capsys):
    command(raising(ValueError("wrong")))
    assert ended(["-q", "info"]) == 2
    assert capsys.readouterr().err == "kfit: wrong\n"


def test_notes_go_to_stderr(command, capsys):
    command(lambda args: talkative(args))
    with pytest.warns(match="careful"):
        main(["info"])
    assert capsys.readouterr() == ("answer\n", "kfit: note\nkfit: warning\n")


def test_quiet_and_verbose_are_not_both_possible(capsys):
    assert ended(["info", "-qv"]) == 2
    assert capsys.readouterr().err == "kfit: --quiet and --verbose were both given; use one of them\n"


def test_what_a_session_changes_is_as_before_after_it(command):
    before = log.level, list(log.handlers)
    command(talkative)
    main(["info", "-q"])
    assert (log.level, log.handlers) == before


@pytest.mark.parametrize("encoding", ["ascii", "cp1251", "cp932", "cp437"])
def test_an_encoding_that_lacks_a_character_gets_an_escape(encoding, command, monkeypatch):
    written = io.BytesIO()
    out = io.TextIOWrapper(written, encoding)
    monkeypatch.setattr(sys, "stdout", out)
    command(lambda args: print("mug 15° away · Größe → жук 口"))
    main(["info"])
    assert out.errors == "strict"
    assert re.fullmatch(r"mug 15.* away .* Gr.*e .*", written.getvalue().decode(encoding).strip())


@pytest.mark.parametrize("backend", ["module://gone.missing", "no_such_backend"])
def test_a_plotting_backend_that_is_missing_is_not_asked_for(backend, command, monkeypatch):
    monkeypatch.setenv("MPLBACKEND", backend)
    backends = []
    command(lambda args: backends.append(os.environ["MPLBACKEND"]))
    main(["info"])
    assert backends == ["agg"]
    assert os.environ["MPLBACKEND"] == backend


@pytest.mark.parametrize("words", [["pose", "-5", "--box", "-5", "0", "-v"], ["fit", "-c", "a.yaml", "-v", "--x=-q"]])
def test_other_words_are_left_in_their_order(words):
    with session(words) as left:
        assert left == [word for word in words if word != "-v"]
        assert log.level == logging.DEBUG


@pytest.mark.parametrize(("terminal", "words", "silent"), [(True, [], False), (True, ["-q"], True), (False, [], True)])
def test_a_bar_is_shown_on_terminals_only_and_not_quietly(terminal, words, silent, monkeypatch, capsys):
    monkeypatch.setenv("FORCE_COLOR", "1")  # rich takes everything for a terminal then
    monkeypatch.setattr(sys.stderr, "isatty", lambda: terminal)
    with session(words):
        assert progress().disable is silent


def test_a_table_fits_a_narrow_terminal_and_is_whole_where_there_is_none(monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "30")
    monkeypatch.setenv("NO_COLOR", "1")
    with session([]):
        assert table_console(140).width == 140
        monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
        assert table_console(140).width == 30
        assert table_console(140).no_color


INTERRUPTED = """
import signal, sys, time
from pathlib import Path
from kfit.cli import info
from kfit.cli.main import main
from kfit.runtime.atomic_write import atomic_write

def write(path):
    path.write_text("half")
    print("ready", flush=True)
    time.sleep(60)

signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell that runs the tests behind it has it ignored
info.run = lambda args: atomic_write(Path(sys.argv[1]), {"answer.txt": write})
main(["info"])
"""


@pytest.mark.skipif(os.name != "posix", reason="sends a signal")
def test_ctrl_c_ends_with_130_says_so_in_a_line_and_leaves_nothing_half_written(tmp_path):
    words = [sys.executable, "-c", INTERRUPTED, str(tmp_path)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as child:
        assert child.stdout.readline() == "ready\n"
        child.send_signal(signal.SIGINT)
        err = child.communicate(timeout=60)[1]
    assert child.returncode == 130
    assert err == "kfit: interrupted\n"
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(os.name != "posix", reason="Windows has no such pipes")
@pytest.mark.parametrize(
    ("words", "statuses"),
    [(["completion", "bash"], [141]), (["info"], [141]), (["--help"], [0, 141])],  # argparse may not mind
)
def test_a_reader_that_stops_reading_gets_no_complaint(words, statuses):
    command = [sys.executable, "-m", "kfit", *words]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as child:
        child.stdout.close()
        child.stdout = None
        err = child.communicate(timeout=120)[1]
    assert child.returncode in statuses
    assert err == ""
