"""Runs the notebooks and saves their outputs in them: python docs/drawings/notebooks.py [--check] [FILE …].

With --check nothing is saved: a notebook whose code fails ends it with an error.
"""

from __future__ import annotations

import ast
import base64
import io
import json
import sys
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

from PIL import Image

FOLDER = Path(__file__).parents[1] / "notebooks"


def run(notebook: dict[str, Any]) -> dict[str, Any]:
    """The same notebook with the outputs of its code: what is printed, and a picture that a cell ends with."""
    names: dict[str, Any] = {}
    cells = []
    for number, cell in enumerate(notebook["cells"]):
        if cell["cell_type"] == "code":
            cell = cell | {"execution_count": None, "outputs": outputs("".join(cell["source"]), names, number)}
        cells.append(cell)
    return notebook | {"cells": cells}


def outputs(source: str, names: dict[str, Any], number: int) -> list[dict[str, Any]]:
    """Of one cell, which is run in a namespace."""
    tree = ast.parse(source)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    printed, shown = io.StringIO(), None
    with redirect_stdout(printed):
        exec(compile(tree, f"cell {number}", "exec"), names)
        if last is not None:
            shown = eval(compile(ast.Expression(last.value), f"cell {number}", "eval"), names)
    found: list[dict[str, Any]] = []
    if isinstance(shown, Image.Image):
        held = io.BytesIO()
        shown.convert("RGB").save(held, "JPEG", quality=88, optimize=True)
        data = {"image/jpeg": base64.b64encode(held.getvalue()).decode()}
        found.append({"output_type": "display_data", "metadata": {}, "data": data})
    elif shown is not None:
        printed.write(f"{shown!r}\n")
    if printed.getvalue():
        text = printed.getvalue().splitlines(keepends=True)
        found.insert(0, {"output_type": "stream", "name": "stdout", "text": text})
    return found


if __name__ == "__main__":
    words = [word for word in sys.argv[1:] if word != "--check"]
    for path in map(Path, words) if words else sorted(FOLDER.glob("*.ipynb")):
        made = run(json.loads(path.read_text(encoding="utf-8")))
        if "--check" not in sys.argv:
            path.write_text(json.dumps(made, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
        print(path)
