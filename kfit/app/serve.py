"""Serving the page on this machine, with restrictions on Gradio."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import sys
import webbrowser
from collections.abc import Awaitable, Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory, gettempdir
from threading import Event
from typing import Any

from kfit.app.sessions import Sessions
from kfit.app.uploads import LARGEST_FILE
from kfit.core.check import check_count
from kfit.models import load
from kfit.runtime.browser import has_screen

LOOPBACK = ("127.0.0.1", "localhost")
# Whatever the page's scripts try, the browser asks nobody but this server. Gradio builds its templates by `Function`.
POLICY = (
    "default-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:; object-src 'none'; frame-ancestors 'none'; "
    "base-uri 'self'; form-action 'self'"
)
PREFIX = "kfit-app-"
SWITCHES = {
    "GRADIO_ANALYTICS_ENABLED": "False",
    "HF_HUB_DISABLE_TELEMETRY": "1",
    "HF_HUB_OFFLINE": "1",
    "DO_NOT_TRACK": "1",
}


class OnlySelf:
    """Makes the browser ask this server alone, and answers no other site's page."""

    def __init__(self, app: Callable[..., Awaitable[None]]) -> None:
        self.app = app

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        """Add headers to an answer; refuse requests from other sites."""
        if scope["type"] == "http":
            headers = dict(scope["headers"])
            origin = headers.get(b"origin")
            if origin is not None and origin.partition(b"://")[2] != headers.get(b"host"):
                await send({"type": "http.response.start", "status": 403, "headers": []})
                await send({"type": "http.response.body", "body": b"Only this page may send requests here."})
                return

        async def with_policy(message: dict[str, Any]) -> None:
            if message["type"] == "http.response.start":
                policies = [(b"content-security-policy", POLICY.encode()), (b"referrer-policy", b"no-referrer")]
                message["headers"] = [*message.get("headers", []), *policies]
            await send(message)

        await self.app(scope, receive, with_policy if scope["type"] == "http" else send)


def serve(host: str, port: int | None, models: Sequence[str] = ()) -> None:
    """Serve the page until Ctrl-C; all uploads are then deleted.

    Args:
        host: address to listen at.
        port: by default the first free one from 7860 on.
        models: paths of models, of categories of their own or in place of bundled models.

    Raises:
        FileNotFoundError: if there is no such model.
        ImportError: where Gradio is not installed.
        ValueError: for a port out of range, a damaged model, or two models of one category.
        OSError: if the host is not an address of this machine, or the port is taken.
    """
    if port is not None:
        check_count("--port", port, 1, 65535)
    _check_host(host)
    known = _by_category(models)
    os.environ.update(SWITCHES)
    remove_left(Path(gettempdir()))
    with TemporaryDirectory(prefix=f"{PREFIX}{os.getpid()}-") as folder:
        os.environ["GRADIO_TEMP_DIR"] = folder  # Gradio reads it when it is imported
        try:
            import gradio as gr
        except ImportError:
            raise ImportError("kfit app needs the package gradio: pip install 'kfit[app]'") from None
        from starlette.middleware import Middleware
        from starlette.middleware.trustedhost import TrustedHostMiddleware

        from kfit.app.layout import HERE
        from kfit.app.page import page

        middleware = [Middleware(OnlySelf)]
        if host in LOOPBACK:  # names that others direct to this address are not names of this machine
            middleware.append(Middleware(TrustedHostMiddleware, allowed_hosts=list(LOOPBACK)))
        blocks = page(Sessions(Path(folder), known))
        try:
            _, address, _ = blocks.launch(
                server_name=host,
                server_port=port,
                share=False,
                quiet=True,
                prevent_thread_lock=True,
                inbrowser=False,
                max_file_size=LARGEST_FILE,
                ssr_mode=False,
                pwa=False,
                mcp_server=False,
                enable_monitoring=False,
                run_history=False,
                footer_links=[],
                theme=gr.themes.Default(
                    primary_hue="amber", font=["system-ui", "sans-serif"], font_mono=["ui-monospace", "monospace"]
                ).set(
                    button_primary_text_color="#1c1c1f",
                    button_primary_text_color_dark="#1c1c1f",
                    button_cancel_background_fill="#b3261e",
                ),
                css_paths=[HERE / "page.css"],
                app_kwargs={"middleware": middleware},
            )
        except OSError as error:
            asked = "7860 and the hundred after it" if port is None else str(port)
            raise OSError(f"port {asked} of {host} cannot be had; name a free one by --port") from error
        signal.signal(signal.SIGTERM, signal.default_int_handler)
        try:
            print(f"kfit: open {address} in a browser; Ctrl-C ends it", file=sys.stderr, flush=True)
            if host in LOOPBACK and has_screen():
                webbrowser.open(address)
            Event().wait()
        except KeyboardInterrupt:
            blocks.close(verbose=False)


def _by_category(models: Sequence[str]) -> dict[str, str]:
    """Return the paths of models by their categories; all are read once, so that errors come before the page."""
    found: dict[str, str] = {}
    for path in models:
        if Path(path).suffix != ".safetensors":
            raise ValueError(f"--models must name .safetensors files, got {path}")
        other = found.setdefault(load(path).card.category, path)
        if other != path:
            raise ValueError(f"--models must have a category each, but {other} and {path} are of the same one")
    return found


def _check_host(host: str) -> None:
    """Refuse what cannot be listened at, which the server would try for minutes, and an empty name, which is all."""
    try:
        if not host:
            raise OSError("it is empty")
        ((family, *_), *_) = socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)
        with socket.socket(family, socket.SOCK_STREAM) as there:
            there.bind((host, 0))
    except (OSError, UnicodeError) as error:
        raise OSError(f"--host must be an address of this machine, got {host!r}: {error}") from None


def remove_left(place: Path) -> None:
    """Delete what servers of this user left in a folder that were killed before they could."""
    if not hasattr(os, "getuid"):  # on Windows asking after a process would end it
        return
    for folder in place.glob(f"{PREFIX}*-*"):
        number = folder.name.removeprefix(PREFIX).partition("-")[0]
        mine = not folder.is_symlink() and folder.is_dir() and folder.stat().st_uid == os.getuid()
        if mine and number.isdecimal() and not _runs(int(number)):
            shutil.rmtree(folder, ignore_errors=True)


def _runs(process: int) -> bool:
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:  # it is somebody else's
        pass
    return True
