"""`kfit bench following`, on a clip of a few frames."""

from __future__ import annotations

from pathlib import Path

import pytest

from kfit.bench.tracking import section
from kfit.cli.main import main


@pytest.mark.slow
def test_it_prints_a_row_for_each_way_and_writes_the_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--categories", "[can]", "--clips", "1", "--frames", "2", "--out", str(tmp_path)]
    main(["bench", "following", *words])
    printed = capsys.readouterr().out
    page = (tmp_path / "README.md").read_text()
    for way in ("by itself", "true masks", "own masks"):
        assert way in printed
        assert way in page


def test_means_are_over_categories() -> None:
    def clip(errors: list[float], seconds: float, confident: list[bool]) -> dict[str, dict[str, object]]:
        return {"true masks": {"errors": errors, "seconds": [seconds] * len(errors), "confident": confident, "anew": 1}}

    mug = clip([2.0, 4.0, 40.0, 50.0], 0.1, [True, False, True, False])
    table = section({"mug": [mug], "can": [clip([2.0], 0.05, [True])]})
    assert table.rows[0] == ["mug", "true masks", "22.0°", "50 %", "50 %", "25 %", "10.0", "10.0", "1"]
    assert table.rows[-1] == ["mean", "true masks", "12.0°", "75 %", "75 %", "12 %", "15.0", "15.0", "1"]


@pytest.mark.parametrize("word", ["clips", "frames", "every"])
def test_a_number_out_of_range_is_named(word: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["bench", "following", f"--{word}", "0"])
    assert f"--{word} must be at least" in capsys.readouterr().err
