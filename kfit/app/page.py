"""The page: its parts, and what each press calls."""

from __future__ import annotations

from typing import Any

import gradio as gr

from kfit.app.actions import Actions
from kfit.app.layout import HERE, Layout
from kfit.app.line import MOST
from kfit.app.sessions import Sessions


def page(sessions: Sessions) -> gr.Blocks:
    """The page, ready to be launched."""
    with gr.Blocks(title="kfit: fit a picture", analytics_enabled=False, delete_cache=(600, 3600)) as blocks:
        connect(Actions(Layout(sessions.models), sessions), blocks)
    blocks.queue(max_size=3 * MOST)
    return blocks


def connect(actions: Actions, blocks: gr.Blocks) -> None:
    """Have each part call what answers it."""
    parts, token = actions.parts, actions.parts.token
    quiet: dict[str, Any] = {"outputs": parts.all, "api_visibility": "private", "show_progress": "minimal"}
    fitted: dict[str, Any] = {
        **quiet,
        "fn": actions.run,
        "inputs": [token, parts.category, parts.camera],
        "concurrency_limit": MOST + 1,  # the last one gets a message that the queue is full
        "scroll_to_output": False,
    }
    example = parts.cards.pick(actions.on_photo(actions.take_example), token, **quiet)
    fits = [parts.fit.click(**fitted), example.success(**fitted)]
    quiet["cancels"] = fits
    parts.drop.upload(actions.on_photo(actions.take), [token, parts.drop], **quiet)
    parts.other.click(actions.on_photo(actions.leave_photo), token, **quiet)
    parts.mask.upload(actions.on_photo(actions.take_mask), [token, parts.mask], **quiet)
    parts.found.input(actions.on_photo(actions.choose), [token, parts.found], **quiet)
    parts.surface.pick(actions.on_photo(actions.tap), token, **quiet)
    parts.surface.draw(actions.on_photo(actions.draw), token, **quiet)
    parts.surface.stroke(actions.on_photo(actions.paint), token, **quiet)
    parts.category.input(actions.on_fit(actions.change_category), [token, parts.category], **quiet)
    parts.camera.input(actions.on_fit(actions.change), token, **quiet)
    parts.depth.upload(actions.on_fit(actions.take_depth), [token, parts.depth], **quiet)
    parts.stop.click(actions.on_fit(actions.change), token, **quiet)
    # A page that is being entered is not dimmed.
    entered = {**quiet, "outputs": [token, *parts.all], "cancels": None, "show_progress": "hidden"}
    blocks.load(actions.enter, token, js=(HERE / "token.js").read_text(encoding="utf-8"), **entered)
    blocks.unload(actions.leave)
