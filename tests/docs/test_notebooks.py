"""The notebooks run, offline, and their saved outputs are those of code that is still in them."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted((ROOT / "docs/notebooks").glob("*.ipynb"))
sys.path.insert(0, str(ROOT / "docs/drawings"))
from notebooks import outputs, run  # noqa: E402


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs_from_its_first_cell_to_its_last(path: Path) -> None:
    made = run(json.loads(path.read_text(encoding="utf-8")))
    saved = json.loads(path.read_text(encoding="utf-8"))
    for now, before in zip(made["cells"], saved["cells"], strict=True):
        kinds = [[output["output_type"] for output in cell.get("outputs", [])] for cell in (now, before)]
        assert kinds[0] == kinds[1], f"{path.name}: run docs/drawings/notebooks.py and commit what it saves"


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_small_and_has_its_outputs(path: Path) -> None:
    assert path.stat().st_size < 400_000
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    assert cells[0]["cell_type"] == "markdown"
    assert any(cell.get("outputs") for cell in cells)


def test_outputs_are_what_is_printed_and_a_last_picture() -> None:
    names: dict[str, object] = {}
    (output,) = outputs("a = 2\nprint(a)\na + 1", names, 0)
    assert output["text"] == ["2\n", "3\n"]
    (shown,) = outputs("from PIL import Image\nImage.new('RGB', (2, 2))", names, 1)
    assert "image/png" in shown["data"]
    with pytest.raises(ZeroDivisionError):
        outputs("1 / 0", names, 2)
