"""`kfit demo`: the first example, shown."""

from __future__ import annotations

import logging
from pathlib import Path

import pytest

from kfit.cli import pose
from kfit.cli.main import main
from kfit.runtime import browser


def test_the_demo_is_a_pose_command_that_can_be_repeated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run = []
    monkeypatch.setattr(pose, "run", run.append)
    monkeypatch.chdir(tmp_path)
    main(["demo"])
    (args,) = run
    assert sorted(path.name for path in Path("kfit_demo").iterdir()) == ["coffee.png", "coffee_mask.png"]
    assert (args.category, args.out, args.open) == ("mug", "kfit_demo", True)
    printed = capsys.readouterr().err
    assert "this is kfit pose kfit_demo/coffee.png --category mug --mask kfit_demo/coffee_mask.png" in printed


def test_files_are_opened_in_the_browser_or_named_where_there_is_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    opened = []
    monkeypatch.setattr(browser.webbrowser, "open", lambda address: opened.append(address) or True)
    monkeypatch.setattr(browser, "has_screen", lambda: True)
    page = tmp_path / "my page.html"
    browser.open_files([page])
    assert opened == [page.as_uri()]
    monkeypatch.setattr(browser, "has_screen", lambda: False)
    with caplog.at_level(logging.INFO, "kfit"):
        browser.open_files([page])
    assert f"open {page} in one" in caplog.text
    assert len(opened) == 1
