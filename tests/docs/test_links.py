"""Links of the README and the pages lead to files that are there, and to headings that are there."""

from __future__ import annotations

import re
import unicodedata
from pathlib import Path

import pytest
from markdown_it import MarkdownIt

ROOT = Path(__file__).parents[2]
KINDS = ("link_open", "image")
PAGES = [
    *(ROOT / name for name in ("README.md", "CHANGELOG.md", "CONTRIBUTING.md", "SECURITY.md")),
    *sorted(page for page in (ROOT / "docs").rglob("*.md") if "_build" not in page.parts),
]


def links_of(text: str) -> list[str]:
    """Targets of a page's links and pictures."""
    inline = [child for token in MarkdownIt().parse(text) for child in token.children or []]
    return [str(token.attrs.get("href") or token.attrs.get("src")) for token in inline if token.type in KINDS]


def anchors_of(text: str) -> set[str]:
    """Names of headings, as repository hosts and MyST make them."""
    tokens = MarkdownIt().parse(text)
    titles = [tokens[at + 1].content for at, token in enumerate(tokens) if token.type == "heading_open"]
    plain = (re.sub(r"[^\w\- ]", "", unicodedata.normalize("NFC", title.lower())) for title in titles)
    return {title.replace(" ", "-") for title in plain}


def broken(page: Path) -> list[str]:
    """Targets in the repository that are not there."""
    wrong = []
    for link in links_of(page.read_text()):
        place, _, anchor = link.partition("#")
        if re.match(r"\w+:", place):
            continue
        target = page.parent / place if place else page
        if not target.exists() or (anchor and anchor not in anchors_of(target.read_text())):
            wrong.append(link)
    return wrong


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_into_the_repository_lead_somewhere(page: Path) -> None:
    assert broken(page) == []


def test_a_link_that_leads_nowhere_is_found(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("# A title\n[here](#a-title) [x](page.md#a-title) [y](#no) ![z](no.png) [w](https://no.where)\n")
    assert broken(page) == ["#no", "no.png"]
