"""The page itself, in Gradio: which parts there are, and what each press does."""

from __future__ import annotations

import functools
import traceback
from collections.abc import Callable, Iterator
from html import escape
from pathlib import Path
from typing import Any

import gradio as gr

from kfit.app import views
from kfit.app.line import MOST, Line
from kfit.app.session import Session, Sessions
from kfit.app.uploads import ENDINGS, LARGEST_FILE, NAMES
from kfit.app.watched import Drawn
from kfit.models.load import bundled

HERE = Path(__file__).parent
HEAD = """<div class="kfit-head"><h1>kfit: fit a picture</h1><p>Finds where an object is and how it is turned, from one
photo: its drawing is moved until it explains what is seen. Everything stays on this machine.</p></div>"""
DRAW = "<b>Drag a box around the object</b>, close to its edges. Or tap two opposite corners."
FOUND = "Bright is what was found. <b>Press Fit</b>, choose another below, or drag a box around it."
MASKED = "Bright is what will be fitted. <b>Choose what it is, and press Fit</b>; not right? Drag another box."
NOTHING = "<b>Drag another box around the object</b>, close to its edges. Or tap two opposite corners."
THANKS = "The cup's mask is drawn by hand. <b>Press Fit</b>, or drag a box of your own."


def page(sessions: Sessions) -> gr.Blocks:
    """The page, ready to be launched."""
    with gr.Blocks(title="kfit: fit a picture", analytics_enabled=False, delete_cache=(600, 3600)) as blocks:
        gr.HTML(HEAD, elem_classes=["kfit-plain"])
        with gr.Row():
            with gr.Column(min_width=320):
                drop = gr.File(label=f"Photo: {NAMES}, at most {LARGEST_FILE >> 20} MB", file_types=ENDINGS, height=190)
                example = gr.Button("Take the example: a cup of coffee")
                surface = gr.HTML(
                    html_template=(HERE / "box.html").read_text(encoding="utf-8"),
                    js_on_load=(HERE / "box.js").read_text(encoding="utf-8"),
                    elem_classes=["kfit-plain"],
                    **{"photo": "", "aspect": 1.0, "mask": "", "hint": ""},
                )
                found = gr.Radio([], label="Found in the photo", visible=False)
                with gr.Row(visible=False) as tools:
                    other = gr.Button("Another photo", size="sm", min_width=120)
                    mask = gr.UploadButton("Upload a mask instead", file_types=ENDINGS, size="sm", min_width=120)
            with gr.Column(min_width=320):
                category = gr.Radio(bundled(), label="What is it?")
                fit = gr.Button("Fit", variant="primary", interactive=False)
                view = gr.HTML(elem_classes=["kfit-plain", "kfit-view"])
                with gr.Row(visible=False) as downloads:
                    report = gr.DownloadButton("Report (HTML)", size="sm", min_width=120)
                    numbers = gr.DownloadButton("Numbers (JSON)", size="sm", min_width=120)

        line = Line()
        fresh = [drop, example, surface, found, tools, category, fit, view, downloads]
        marked = [surface, fit, view, downloads]

        def picture(session: Session, category: str | None, hint: str) -> list[Any]:
            """Where a picture is there, it stands where it could be dropped."""
            photo = session.photo
            return [
                gr.update(visible=photo is None, value=None),
                gr.update(visible=photo is None),
                gr.update(
                    photo="" if photo is None else views.photo_shown(photo.image),
                    aspect=1.0 if photo is None else photo.image.shape[1] / photo.image.shape[0],
                    **layer(session, hint),
                ),
                gr.update(
                    choices=[(name, number) for number, name in enumerate(session.found())],
                    value=0 if session.targets else None,
                    visible=bool(session.targets),
                ),
                gr.update(visible=photo is not None),
                gr.update(value=category),
                *after(session)[1:],
            ]

        def layer(session: Session, hint: str) -> dict[str, str]:
            return {"mask": "" if session.mask is None else views.mask_shown(session.mask), "hint": hint}

        def after(session: Session, hint: str = "") -> list[Any]:
            """What was answered before is gone."""
            return [
                gr.update(**layer(session, hint)),
                gr.update(interactive=session.mask is not None),
                "",
                gr.update(visible=False),
            ]

        def take(file: str, request: gr.Request) -> list[Any]:
            session = sessions.of(request.session_hash or "")
            try:
                session.take(Path(file))
            except Exception as error:
                _tell(error)
            if session.targets:
                return picture(session, session.targets[0].category, FOUND)
            return picture(session, None, DRAW if session.mask is None else MASKED)

        @_told
        def choose(number: int, request: gr.Request) -> list[Any]:
            session = sessions.of(request.session_hash or "")
            session.choose(number)
            return [*after(session, FOUND), gr.update(value=session.targets[number].category)]

        @_told
        def take_example(request: gr.Request) -> list[Any]:
            session = sessions.of(request.session_hash or "")
            session.take_example()
            return picture(session, "mug", THANKS)

        @_told
        def leave(request: gr.Request) -> list[Any]:
            sessions.close(request.session_hash or "")
            return picture(sessions.of(request.session_hash or ""), None, "")

        @_told
        def take_mask(file: str, request: gr.Request) -> list[Any]:
            session = sessions.of(request.session_hash or "")
            session.take_mask(Path(file))
            return after(session, MASKED)

        @_told
        def draw(event: gr.EventData, request: gr.Request) -> list[Any]:
            session = sessions.of(request.session_hash or "")
            try:
                session.draw(tuple(float(part) for part in event.box))  # type: ignore[arg-type]
            except ValueError as error:
                _tell(error)
                return after(session, NOTHING)
            return after(session, MASKED)

        def run(category: str | None, request: gr.Request) -> Iterator[list[Any]]:
            session = sessions.of(request.session_hash or "")
            hidden, same = gr.update(visible=False), gr.skip()
            steps: list[Drawn] = []
            session.busy = True
            try:
                with line.joined() as waiting:
                    for before in waiting:
                        yield [views.waiting(before), hidden, same, same]
                    fitting = session.fit(category)
                    yield [views.converging(steps), hidden, same, same]
                    for news in fitting:
                        if isinstance(news, Drawn):
                            steps.append(news)
                            yield [views.converging(steps), hidden, same, same]
                        else:
                            yield [views.answered(news, steps), hidden, same, same]
                            yield [same, gr.update(visible=True), *map(str, session.write(news))]
            except Exception as error:
                _tell(error)
                yield [same if steps else "", hidden, same, same]
            finally:
                session.busy = False

        def forget(request: gr.Request) -> None:
            sessions.close(request.session_hash or "")

        quiet: dict[str, Any] = {"api_visibility": "private", "show_progress": "minimal"}
        fitting = fit.click(
            run,
            category,
            [view, downloads, report, numbers],
            concurrency_limit=MOST + 1,  # the last is told that the line is full
            scroll_to_output=True,
            **quiet,
        )
        drop.upload(take, drop, fresh, cancels=fitting, **quiet)
        example.click(take_example, None, fresh, cancels=fitting, **quiet)
        other.click(leave, None, fresh, cancels=fitting, **quiet)
        mask.upload(take_mask, mask, marked, cancels=fitting, **quiet)
        found.input(choose, found, [*marked, category], cancels=fitting, **quiet)
        surface.draw(draw, None, marked, cancels=fitting, **quiet)
        blocks.unload(forget)
    blocks.queue(max_size=3 * MOST)
    return blocks


def _told(work: Callable[..., Any]) -> Callable[..., Any]:
    """The same, with a mistake told as one sentence in the page, which stays as it is."""

    @functools.wraps(work)
    def once(*args: Any) -> Any:
        try:
            return work(*args)
        except Exception as error:
            _tell(error)
            return gr.skip()

    return once


def _tell(error: Exception) -> None:
    """One sentence in the page; of what nobody foresaw, all is told in the terminal."""
    if isinstance(error, ValueError | OSError | RuntimeError | ImportError):
        sentence = str(error)
    else:
        traceback.print_exception(error)
        sentence = "Something went wrong that kfit did not foresee; the terminal in which it runs tells more."
    gr.Warning(escape(sentence), title="That did not work")
