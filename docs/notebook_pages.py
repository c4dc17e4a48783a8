"""Notebooks as pages: their text, code and saved outputs, turned into Markdown when Sphinx reads an .ipynb file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sphinx.application import Sphinx


def page_of(notebook: dict[str, Any], name: str) -> str:
    """Markdown of a notebook, with a link that downloads it at the end."""
    parts = []
    for cell in notebook["cells"]:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(source)
            continue
        parts.append(_fenced("python", source))
        for output in cell["outputs"]:
            if output["output_type"] == "stream":
                parts.append(_fenced("text", "".join(output["text"])))
            else:
                parts.append(f"![What the code above shows](data:image/jpeg;base64,{output['data']['image/jpeg']})")
    parts.append(f"{{download}}`Download this page as a notebook <{name}>`, and run it with Jupyter.")
    return "\n\n".join(parts) + "\n"


def _fenced(language: str, text: str) -> str:
    return f"````{language}\n{text.rstrip()}\n````"


def on_read(app: Sphinx, docname: str, content: list[str]) -> None:
    """Replace the file's JSON by the page."""
    path = Path(app.env.doc2path(docname))
    if path.suffix == ".ipynb":
        content[0] = page_of(json.loads(content[0]), path.name)


def setup(app: Sphinx) -> dict[str, bool]:
    """Called by Sphinx."""
    app.add_source_suffix(".ipynb", "markdown")
    app.connect("source-read", on_read)
    return {"parallel_read_safe": True}
