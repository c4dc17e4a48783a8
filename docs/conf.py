"""Sphinx's settings: `python -m sphinx -b html -W --keep-going -n docs docs/_build` makes the pages.

Links to other sites are tried, where there is a network, by `python -m sphinx -b linkcheck docs docs/_build/linkcheck`.
"""

from __future__ import annotations

import os
import re
import sys
from abc import ABC
from pathlib import Path
from typing import Any

os.environ["COLUMNS"] = "88"  # of the commands' own help
sys.path.insert(0, str(Path(__file__).parent))

from sphinx.application import Sphinx

import kfit
from kfit import __version__

project = "kfit"
author = "The kfit authors"
copyright = "The kfit authors, Apache-2.0"
version = release = __version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "sphinx_copybutton",
    "command_help",
    "notebook_pages",
]
exclude_patterns = ["_build", "_templates"]
templates_path = ["_templates"]
myst_enable_extensions = ["colon_fence"]
myst_heading_anchors = 3
suppress_warnings = ["myst.header"]  # results begin with what a section is about, and not with its level

# Docstrings name what they speak of in single backticks, as `kfit.FitPipeline`.
default_role = "py:obj"
autodoc_default_options = {
    "members": True,
    "show-inheritance": True,
    "member-order": "bysource",
    "exclude-members": "loss",  # Kornia's functions, which robust energies rest on
}
autodoc_inherit_docstrings = False  # a contract is told once, in kfit.core
autodoc_typehints_format = "short"
autodoc_preserve_defaults = False  # it fails on signatures that functions are given
add_module_names = False
python_maximum_signature_line_length = 88
napoleon_numpy_docstring = False
napoleon_use_rtype = False
# As lists, in which several names may share a line.
napoleon_use_param = False
napoleon_custom_sections = [("Attributes", "params_style")]
autosummary_ignore_module_all = False
# Names of other projects, whose pages are not at hand where there is no network, and of kfit's own inner types.
nitpick_ignore_regex = [
    ("py:.*", r"(torch|torchmetrics|kornia|numpy|np|lightning|jsonargparse|pathlib|collections|contextlib)\..*"),
    # Types in signatures whose modules are imported for type checkers alone.
    ("py:class", r"nn\.Module|NDArray|Path|PhotoLike|Tensor|Trimesh"),
    ("py:class", r"kfit\.(core\.frozen\.Module|core\.part\.Part|geometry\.pose\.Angles|generators\.surface\.Surface)"),
    ("py:class", r"kfit\.pose\.(hypotheses\.PoseHypotheses|confidence\.Calibration|observed_object\.ObservedObject)"),
    (
        "py:class",
        r"kfit\.(data\.nocs_models\.NOCSModel|training\.training\.Training|pose\.category_networks\.CategoryNetworks)",
    ),
    ("py:class", r"kfit\.data\.(mesh_places\.MeshFile|annotated_frame\.AnnotatedFrame)"),
    ("py:class", r"kfit\.training\.random_crop\.RolledCrop"),
]
# Constants have no docstrings that could be found where they are offered.
CONSTANTS = {
    "kfit.__version__": "Version of the package.",
    "kfit.core.Variables": "Tensors by the names of variables, ``dict[str, Tensor]``.",
    "kfit.data.CATEGORIES": "Names of the categories, in the order of NOCS's class ids 1 to 6.",
    "kfit.geometry.CATEGORIES": "What is known of each category, `Category` by name.",
    "kfit.geometry.EDGES": "Pairs of corners of `box_corners` that edges of the box join.",
    "kfit.geometry.SYMMETRIES": "Names of symmetries.",
    "kfit.geometry.Symmetry": 'Of an object: ``"none"``, or ``"y"`` where it looks the same turned about its y axis.',
    "kfit.geometry.UNIT_FRACTION": "Share of a drawing's width that a unit diagonal spans at scale 1.",
    "kfit.segmentation.Box": "Left, top, width and height in pixels, four numbers.",
}
autosummary_context = {"constants": CONSTANTS}

html_theme = "furo"
html_title = f"kfit {__version__}"
html_static_path = ["_static"]
html_css_files = ["pages.css"]
html_logo = html_favicon = "_static/logo.svg"
copybutton_prompt_text = r"\$ "
copybutton_prompt_is_regexp = True


def from_root(app: Sphinx, path: Path, docname: str, text: list[str]) -> None:
    """The README's links start at the repository's root, a level above the page that includes it.

    Links to folders, and to the root's pages that are not included here, stay text.
    """
    root, included = Path(app.srcdir).parent, {"CONTRIBUTING.md": "contributing.md", "CHANGELOG.md": "changelog.md"}

    def moved(found: re.Match[str]) -> str:
        if (root / found[2]).is_dir() or found[2] in ("README.md", "SECURITY.md"):
            return found[1]
        return f"[{found[1]}]({included.get(found[2], f'../{found[2]}')})"

    text[0] = re.sub(r"\[([^\]]*)\]\((?!https?:|#)([^)]*)\)", moved, text[0])


def in_rst(app: Sphinx, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Docstrings as docutils wants them: bars of |x| are no substitutions, words of a command no names."""

    def plain(found: re.Match[str]) -> str:
        return found[1] or (f"`{found[2]}`" if found[2] else r"\|")

    if name in CONSTANTS:
        lines[:] = [CONSTANTS[name]]
    lines[:] = [re.sub(r"(``.*?``)|(`\w+ [^`]*`)|\|", plain, line) for line in lines]


def public(app: Sphinx, name: str, thing: type, options: Any, bases: list[type]) -> None:
    """Bases that a reader may know: instead of private ones, theirs."""
    while hidden := [base for base in bases if base.__name__.startswith("_")]:
        at = bases.index(hidden[0])
        bases[at : at + 1] = hidden[0].__bases__
    bases[:] = [base for base in bases if base is not ABC] or [object]


def with_factories(app: Sphinx, what: str, name: str, thing: Any, options: Any, words: str, back: str) -> Any:
    """Signatures without a field's ``<factory>``, which is no value, and without what `torch.nn.Module` would take."""
    said = "" if words and words.startswith("(*args") else words
    return (said.replace("<factory>", "..."), back) if words else None


def at_home(app: Sphinx, env: Any, node: Any, content: Any) -> Any:
    """A class that kfit offers under a short name, such as `kfit.Generator`, where its own room describes it."""
    package, _, name = str(node.get("reftarget", "")).rpartition(".")
    if package != "kfit" or name not in kfit._HOMES:
        return None
    room = ".".join(kfit._HOMES[name].split(".")[:2])
    return env.domains["py"].resolve_xref(env, node["refdoc"], app.builder, "obj", f"{room}.{name}", node, content)


def setup(app: Sphinx) -> None:
    """Called by Sphinx."""
    app.connect("missing-reference", at_home)
    app.connect("autodoc-process-signature", with_factories)
    app.connect("include-read", from_root)
    app.connect("autodoc-process-docstring", in_rst)
    app.connect("autodoc-process-bases", public)
