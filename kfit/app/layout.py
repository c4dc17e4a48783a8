"""The parts of the page and where they stand."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import gradio as gr

from kfit.app import views
from kfit.app.downloads import FILES
from kfit.app.uploads import ENDINGS, NAMES
from kfit.models.load import bundled
from kfit.reports.scene import VIEWER

HERE = Path(__file__).parent
HEAD = """<div class="kfit-head"><h1>kfit: fit a picture</h1><p>Finds where a {names} is and how it is turned, from one
photo: a drawing of it is moved until it explains what is seen. Everything stays on this machine.</p></div>"""


class Layout:
    """All parts of the page, made within Gradio's Blocks.

    Args:
        categories: categories that are served in addition to the bundled models'.
    """

    def __init__(self, categories: Iterable[str] = ()) -> None:
        plain = {"elem_classes": ["kfit-plain"]}
        known = list(dict.fromkeys([*bundled(), *categories]))
        self.token = gr.Textbox(visible="hidden", label="visit")
        gr.HTML(HEAD.format(names=f"{', '.join(known[:-1])} or {known[-1]}"), **plain)
        self.steps = gr.HTML(views.steps(0), **plain)
        with gr.Row(elem_classes=["kfit-grid"]):
            with gr.Column(min_width=300):
                # Shown once the visit has its token: nothing can be pressed before.
                self.drop = gr.File(label=f"Photo: {NAMES}", file_types=ENDINGS, height=170, visible=False)
                self.cards = gr.HTML(views.cards(), js_on_load=_script("cards.js"), visible=False, **plain)
                self.photo_problem = gr.HTML('<p class="kfit-busy" role="status">Connecting …</p>', **plain)
                self.surface = gr.HTML(
                    html_template=(HERE / "stage.html").read_text(encoding="utf-8"),
                    js_on_load=_script("stage.js"),
                    photo="",
                    aspect=1.0,
                    mask="",
                    hint="",
                    found="",
                    **plain,
                )
                self.found = gr.Radio([], label="Found in the photo", visible=False)
                with gr.Row(visible=False) as self.tools:
                    self.other = gr.Button("Another photo", size="md", min_width=120)
                    self.mask = gr.UploadButton("Upload a mask", file_types=ENDINGS, size="md", min_width=120)
            with gr.Column(min_width=300, visible=False, elem_classes=["kfit-right"]) as self.right:
                self.category = gr.Radio(known, label="What is it?")
                with gr.Accordion("Camera and depth, if you know them", open=False):
                    self.camera = gr.Textbox(
                        label="Intrinsics in pixels: fx fy cx cy", placeholder="by EXIF tags, else estimated"
                    )
                    self.depth = gr.UploadButton(
                        "Depth: 16-bit PNG of millimetres, or .npy of metres", file_types=[".png", ".npy"], size="md"
                    )
                    self.depth_name = gr.HTML("", **plain)
                self.fit = gr.Button("Fit", variant="primary", interactive=False)
                self.stop = gr.Button("Stop", variant="stop", visible=False)
                self.fit_problem = gr.HTML("", **plain)
                self.view = gr.HTML(js_on_load=_script("view.js"), elem_classes=["kfit-plain", "kfit-view"])
            with gr.Column(min_width=300):
                self.solid = gr.HTML(
                    html_template="${value}",
                    js_on_load=f"{VIEWER.read_text(encoding='utf-8')}\n{_script('solid.js')}",
                    scene="",
                    visible=False,
                    elem_classes=["kfit-plain", "kfit-solid"],
                )
                with gr.Row(visible=False) as self.downloads:
                    self.files = {
                        name: gr.DownloadButton(label, size="md", min_width=150) for name, label in FILES.items()
                    }

    @property
    def all(self) -> list[gr.components.Component]:
        """Whatever an action may change."""
        return [part for name, part in vars(self).items() if name not in ("files", "token")] + list(self.files.values())


def _script(name: str) -> str:
    return (HERE / name).read_text(encoding="utf-8")
