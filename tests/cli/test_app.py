"""``kfit app``: what it says before a page is there."""

import socket
import subprocess
import sys
from importlib.util import find_spec

import pytest

from kfit.cli.main import main


def refused(words, capsys):
    with pytest.raises(SystemExit) as stopped:
        main(words)
    assert stopped.value.code == 2
    return capsys.readouterr().err


def test_without_gradio_it_says_in_one_sentence_how_to_install_it(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "gradio", None)
    assert refused(["app"], capsys) == "kfit: kfit app needs the package gradio: pip install 'kfit[app]'\n"


def test_the_help_says_what_another_host_means(capsys):
    with pytest.raises(SystemExit):
        main(["app", "--help"])
    printed = " ".join(capsys.readouterr().out.split())
    assert "any other than this one lets everybody who can reach this machine use the page" in printed


def test_the_process_ends_without_waiting_for_threads_that_compute(monkeypatch):
    codes = []
    monkeypatch.setattr("kfit.app.serve.serve", lambda *settings: None)
    monkeypatch.setattr("os._exit", codes.append)
    main(["app"])
    assert codes == [0]


@pytest.mark.slow  # imports Gradio
def test_a_port_that_is_taken_is_reported():
    if find_spec("gradio") is None:
        pytest.skip("gradio is not installed")
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        words = [sys.executable, "-m", "kfit", "app", "--port", str(port)]
        done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr == f"kfit: port {port} of 127.0.0.1 cannot be had; name a free one by --port\n"
