"""Open a local page: choose an example or a photo, watch the fit, rotate the answer.

Needs the package's extra: pip install 'kfit[app]'.
"""

from __future__ import annotations

import os

from jsonargparse import ArgumentParser, Namespace


def parser() -> ArgumentParser:
    """Arguments of ``kfit app``."""
    parser = ArgumentParser(
        description="Open a page on this machine where a photo is dropped, the object is chosen or outlined, the fit "
        "is watched and its answer turned in 3D; report, numbers, picture, mesh and a program that repeats it "
        "can be downloaded. Photos stay on this machine, in memory, and are forgotten a minute after the page is "
        "closed. Needs: pip install 'kfit[app]'.",
        epilog="""examples:
  kfit app --port 8000
  kfit app --models teapot.safetensors""",
    )
    parser.add_argument("--port", type=int, default=None, help="port to listen at; the first free one from 7860")
    parser.add_argument(
        "--host",
        type=str,
        default="127.0.0.1",
        help="address to listen at; any other than this one lets everybody who can reach this machine use the page, "
        "which has no password",
    )
    parser.add_argument(
        "--models",
        type=list[str] | str,
        default=[],
        metavar="[FILE.safetensors,…]",
        help="one or several models of your own, of categories of your own or in place of bundled models",
    )
    return parser


def run(args: Namespace) -> None:
    """Serve the page until Ctrl-C, then end the process."""
    from kfit.app.serve import serve

    serve(args.host, args.port, [args.models] if isinstance(args.models, str) else args.models)
    # Gradio's threads may still compute. Python would stop them inside torch as it ends, which aborts or hangs.
    os._exit(0)
