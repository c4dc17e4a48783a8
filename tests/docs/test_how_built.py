"""The page on how kfit is built, and its drawing, show all folders of the package as they are."""

import re
import runpy
from pathlib import Path

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
FOLDERS = {path.parent.name for path in (ROOT / "kfit").glob("*/__init__.py")}


def test_the_drawing_is_that_of_its_script():
    drawing = runpy.run_path(str(DOCS / "drawings/how_built.py"))["drawing"]()
    assert (DOCS / "pictures/how_built.svg").read_text() == drawing


def test_the_drawing_has_every_folder_above_all_that_it_imports():
    floors = runpy.run_path(str(DOCS / "drawings/how_built.py"))["FLOORS"]
    heights = runpy.run_path(str(ROOT / "tests/test_import_direction.py"))["HEIGHT"]
    drawn = [name for _, _, names in reversed(floors) for name in names]
    assert sorted(drawn) == sorted(FOLDERS)
    assert [heights[name] for name in drawn if name not in ("cli", "app")] == sorted(
        heights[name] for name in drawn if name not in ("cli", "app")
    )


def test_the_page_describes_every_folder():
    rows = re.findall(r"^\| (`.*`) \|", (DOCS / "how-kfit-is-built.md").read_text(), re.MULTILINE)
    assert sorted(name for row in rows for name in re.findall(r"`(\w+)`", row)) == sorted(FOLDERS)
