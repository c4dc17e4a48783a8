"""What the page does when a visitor does something."""

from __future__ import annotations

import functools
import json
import re
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import gradio as gr

from kfit.app import views
from kfit.app.camera_text import camera_of
from kfit.app.examples import EXAMPLES
from kfit.app.layout import Layout
from kfit.app.line import Line
from kfit.app.session import Session
from kfit.app.sessions import Sessions
from kfit.app.watched import Drawn
from kfit.geometry import CATEGORIES
from kfit.pose import PoseResult
from kfit.reports.scene import scene, scene_html

BOX = "<b>Drag a box around the object</b>, close to its edges. Or tap two opposite corners."
FOUND = "Bright is what was found. <b>Press Fit</b>, tap another, drag a box, or correct what is bright."
MASKED = "Bright is what will be fitted. <b>{} what it is, and press Fit</b>; not right? Correct it, or drag a box."
AGAIN = "<b>Drag another box around the object</b>, close to its edges. Or tap two opposite corners."
THANKS = "The example's mask is bright. Correct it, or drag a box of your own, and press Fit for another answer."
Changes = dict[Any, Any]


class Actions:
    """Answers what visitors do, each by the changes of the page's parts.

    Args:
        parts: parts of the page.
        sessions: sessions of all visitors.
    """

    def __init__(self, parts: Layout, sessions: Sessions) -> None:
        self.parts, self.sessions, self.line = parts, sessions, Line()
        own = " or ".join(name for name in sessions.models if name not in CATEGORIES)
        self.found = FOUND + (f" For {own}, <b>choose it first</b>: kfit finds only its own categories." if own else "")
        # Gradio tells a page that was closed by another name than the visit's.
        self.pages: dict[str, str] = {}

    def on_photo(self, work: Callable[..., Changes]) -> Callable[..., Changes]:
        """The same, with a mistake named below the photo."""
        return self._with_message(work, self.parts.photo_problem)

    def on_fit(self, work: Callable[..., Changes]) -> Callable[..., Changes]:
        """The same, with a mistake named below the button that fits."""
        return self._with_message(work, self.parts.fit_problem)

    def _with_message(self, work: Callable[..., Changes], place: gr.HTML) -> Callable[..., Changes]:
        # Gradio reads from the signature where it is to hand over an event.
        @functools.wraps(work)
        def once(*args: Any) -> Changes:
            try:
                return work(*args)
            except Exception as error:
                return {place: views.problem(sentence_of(error))}

        return once

    def enter(self, token: str, request: gr.Request) -> Changes:
        """Begin a visit, or go on with one whose page was loaded anew."""
        if not re.fullmatch(r"[0-9a-f]{32}", token or ""):
            token = request.session_hash or ""
        self.pages[request.session_hash or ""] = token
        return {self.parts.token: token, **self._shown(self.sessions.of(token), self.found)}

    def leave(self, request: gr.Request) -> None:
        """Forget a visit soon whose page was closed, unless another page, such as the reloaded one, goes on with it."""
        token = self.pages.pop(request.session_hash or "", "")
        if token not in self.pages.values():
            self.sessions.leave(token)

    def take(self, token: str, file: str) -> Changes:
        """Take a photo."""
        session = self.sessions.of(token)
        try:
            session.take(Path(file))
        except Exception as error:
            return {**self._shown(session, self.found), self.parts.photo_problem: views.problem(sentence_of(error))}
        return self._shown(
            session, self.found if session.targets else BOX if session.mask is None else _masked_hint(session)
        )

    def take_example(self, token: str, event: gr.EventData) -> Changes:
        """Take an example."""
        session = self.sessions.of(token)
        session.take_example(next(example for example in EXAMPLES if example.name == event.name))
        return self._shown(session, THANKS)

    def leave_photo(self, token: str) -> Changes:
        """Make room for another photo."""
        self.sessions.of(token).clear()
        return self._shown(self.sessions.of(token), "")

    def choose(self, token: str, number: int) -> Changes:
        """Take another of the objects that were found."""
        session = self.sessions.of(token)
        session.choose(number)
        return {**self._masked(session, self.found), self.parts.found: number}

    def tap(self, token: str, event: gr.EventData) -> Changes:
        """The same, by a tap on it."""
        return self.choose(token, int(event.number))

    def take_mask(self, token: str, file: str) -> Changes:
        """Take a mask from a file."""
        session = self.sessions.of(token)
        session.take_mask(Path(file))
        return self._masked(session)

    def draw(self, token: str, event: gr.EventData) -> Changes:
        """Find the object in a box."""
        session = self.sessions.of(token)
        try:
            session.draw(tuple(float(part) for part in event.box))  # type: ignore[arg-type]
        except ValueError as error:
            return {**self._masked(session, AGAIN), self.parts.photo_problem: views.problem(str(error))}
        return self._masked(session)

    def paint(self, token: str, event: gr.EventData) -> Changes:
        """Correct the mask by a stroke."""
        session = self.sessions.of(token)
        session.paint([(float(x), float(y)) for x, y in event.points], bool(event.keep))
        return self._masked(session)

    def change_category(self, token: str, category: str) -> Changes:
        """Note what the visitor takes the object for."""
        self.sessions.of(token).category = category
        return self.change(token)

    def take_depth(self, token: str, file: str) -> Changes:
        """Take a depth map from a file."""
        self.sessions.of(token).take_depth(Path(file))
        return {**self.change(token), self.parts.depth_name: "<p>Depth is used; it fixes distance and size.</p>"}

    def change(self, token: str) -> Changes:
        """Drop an answer that rests on what has changed."""
        return self._without_answer(self.sessions.of(token))

    def run(self, token: str, category: str | None, camera: str) -> Iterator[Changes]:
        """Fit, and show how it goes, then the answer."""
        parts, session = self.parts, self.sessions.of(token)
        steps: list[Drawn] = []
        session.busy = True
        try:
            yield {**self._without_answer(session), parts.fit: gr.update(visible=False)} | {
                parts.stop: gr.update(visible=True)
            }
            lens = camera_of(camera)
            with self.line.joined() as waiting:
                for before in waiting:
                    yield {parts.view: views.waiting(before)}
                yield {parts.view: views.converging(steps, session.image)}
                for news in session.fit(category, lens):
                    if isinstance(news, Drawn):
                        steps.append(news)
                        yield {parts.view: views.converging(steps, session.image)}
                    else:
                        yield self._answered(news, steps)
                        files = session.write(news, lens)
                        yield {parts.downloads: gr.update(visible=True)} | {
                            part: gr.update(value=str(files[name]), visible=True)
                            if name in files
                            else gr.update(visible=False)
                            for name, part in parts.files.items()
                        }
        except Exception as error:
            problem = views.problem(sentence_of(error))
            yield {**self._without_answer(session), parts.fit_problem: problem}
        finally:
            session.busy = False

    def _answered(self, result: PoseResult, steps: list[Drawn]) -> Changes:
        parts, made = self.parts, scene(result)
        return {
            parts.steps: views.steps(2),
            parts.view: views.answered(result, steps),
            parts.solid: gr.update(value=str(scene_html(result, made)), scene=json.dumps(made), visible=True),
            parts.fit: gr.update(visible=True),
            parts.stop: gr.update(visible=False),
        }

    def _shown(self, session: Session, hint: str) -> Changes:
        """All of a session; where a picture is there, it stands where it could be dropped."""
        parts, photo = self.parts, session.photo
        there = photo is not None
        names = [(name, number) for number, name in enumerate(session.found())]
        image = gr.update(photo="", aspect=1.0, mask="", hint="", found="")
        if photo is not None:
            height, width = photo.image.shape[:2]
            found = views.found_shown(session.targets, (height, width))
            image = gr.update(
                photo=views.photo_shown(photo.image), aspect=width / height, found=found, **_layer(session, hint)
            )
        return {
            **self._without_answer(session),
            parts.drop: gr.update(visible=not there, value=None),
            parts.cards: gr.update(visible=not there),
            parts.surface: image,
            parts.found: gr.update(choices=names, value=0 if names else None, visible=len(names) > 1),
            parts.tools: gr.update(visible=there),
            parts.right: gr.update(visible=there),
            parts.category: session.category,
            parts.depth_name: "",
        }

    def _masked(self, session: Session, hint: str | None = None) -> Changes:
        layer = gr.update(**_layer(session, hint or _masked_hint(session)))
        return {**self._without_answer(session), self.parts.surface: layer, self.parts.category: session.category}

    def _without_answer(self, session: Session) -> Changes:
        parts = self.parts
        return {
            parts.steps: views.steps(0 if session.photo is None else 1),
            parts.photo_problem: "",
            parts.fit_problem: "",
            parts.view: "",
            parts.solid: gr.update(value="", scene="", visible=False),
            parts.downloads: gr.update(visible=False),
            parts.fit: gr.update(visible=True, interactive=session.mask is not None),
            parts.stop: gr.update(visible=False),
        }


def _masked_hint(session: Session) -> str:
    return MASKED.format("Choose" if session.category is None else "Check")


def _layer(session: Session, hint: str) -> dict[str, str]:
    return {"mask": "" if session.mask is None else views.mask_shown(session.mask), "hint": hint}


def sentence_of(error: Exception) -> str:
    """Return one sentence for a visitor; unexpected errors are printed in full in the terminal."""
    if isinstance(error, ValueError | OSError | RuntimeError | ImportError):
        return str(error)
    traceback.print_exception(error)
    return "An unexpected error occurred; the terminal in which kfit runs has the details."
