"""The reference has a page for every room that offers names."""

from __future__ import annotations

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]


def offers_names(file: Path) -> bool:
    """Whether a package says by ``__all__`` what it offers."""
    assigned = [node for node in ast.parse(file.read_text()).body if isinstance(node, ast.Assign)]
    return any(isinstance(to, ast.Name) and to.id == "__all__" for node in assigned for to in node.targets)


def test_every_room_that_offers_names_has_a_page() -> None:
    listed = set(re.findall(r"^   (kfit[\w.]*)$", (ROOT / "docs/api/index.md").read_text(), re.MULTILINE))
    packages = [file for file in (ROOT / "kfit").rglob("__init__.py") if offers_names(file)]
    rooms = {".".join(file.parent.relative_to(ROOT).parts) for file in packages}
    assert len(rooms) > 15
    assert rooms <= listed
