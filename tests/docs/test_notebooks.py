"""The notebooks run, offline, and their saved outputs are those of code that is still in them."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted((ROOT / "docs/notebooks").glob("*.ipynb"))
sys.path[:0] = [str(ROOT / "docs"), str(ROOT / "docs/drawings")]
from notebook_pages import page_of  # noqa: E402
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


def test_there_are_notebooks_of_a_pose_a_fit_and_a_registration() -> None:
    assert [path.stem for path in NOTEBOOKS] == ["compose_a_fit", "pose_of_a_photo", "register_two_pictures"]


def test_a_page_has_text_code_outputs_and_a_link_to_the_notebook() -> None:
    code = {"cell_type": "code", "source": ["print(1)\n", "picture"]}
    code["outputs"] = [
        {"output_type": "stream", "text": ["1\n"]},
        {"output_type": "display_data", "data": {"image/jpeg": "QUJD"}},
    ]
    page = page_of({"cells": [{"cell_type": "markdown", "source": ["# A title"]}, code]}, "a.ipynb")
    shown = "![What the code above shows](data:image/jpeg;base64,QUJD)"
    assert page.startswith(f"# A title\n\n````python\nprint(1)\npicture\n````\n\n````text\n1\n````\n\n{shown}\n\n")
    assert page.count("<a.ipynb>") == 1


def test_outputs_are_what_is_printed_and_a_last_picture() -> None:
    names: dict[str, object] = {}
    (output,) = outputs("a = 2\nprint(a)\na + 1", names, 0)
    assert output["text"] == ["2\n", "3\n"]
    (shown,) = outputs("from PIL import Image\nImage.new('RGB', (2, 2))", names, 1)
    assert "image/jpeg" in shown["data"]
    with pytest.raises(ZeroDivisionError):
        outputs("1 / 0", names, 2)
