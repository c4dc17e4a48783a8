"""`kfit bench training`."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest

from kfit.bench.training import section
from kfit.cli.main import main

RECIPES = Path(__file__).parents[2] / "recipes"


def test_rates_are_of_operations_over_the_whole_step() -> None:
    clock = SimpleNamespace(precision="bf16-mixed", seconds=0.5, waited=0.5, pairs=32, operations=10e9, machine=40.0)
    (row,) = section({"recipes/some.yaml": clock}).rows
    assert row == ["some", "bf16-mixed", "500.0 ms", "64", "50.0 %", "10", "20 GFLOP/s", "50 %"]


@pytest.mark.parametrize(
    ("words", "message"),
    [(["--recipes", "[gone.yaml]"], "there is no recipe gone.yaml"), (["--steps", "0"], "--steps must be at least 1")],
)
def test_a_users_mistake_gets_one_sentence(words: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["bench", "training", *words])
    assert message in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # Lightning's own
def test_it_trains_and_prints_a_row(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    main(["bench", "training", "--recipes", f"[{RECIPES / 'smoke.yaml'}]", "--steps", "1", "--out", "out"])
    assert "smoke" in capsys.readouterr().out
    assert "GFLOP/s" in Path("out/README.md").read_text()
    assert [path.name for path in tmp_path.iterdir()] == ["out"]  # the training leaves nothing
