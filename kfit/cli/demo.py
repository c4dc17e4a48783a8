"""Find the pose of the cup in a photo that kfit's packages ship, and show it in a browser.

Writes what `kfit pose` writes, and a page about the fit.
"""

from __future__ import annotations

from pathlib import Path

from jsonargparse import ArgumentParser, Namespace

from kfit.cli import pose
from kfit.runtime.console import log


def parser() -> ArgumentParser:
    """Arguments of ``kfit demo``."""
    parser = ArgumentParser(
        description="Run the first example: find the pose of the cup in a photo that scikit-image ships, and show the "
        "page about it in a browser. Nothing is downloaded. DIR gets the photo and its mask, pose.json, overlay.png "
        "and report.html.",
        epilog="""example:
  kfit demo""",
    )
    parser.add_argument("--out", type=str, default="kfit_demo", help="folder to write to", metavar="DIR")
    return parser


def run(args: Namespace) -> None:
    """Write the photo, and run `kfit pose` on it."""
    from kfit.app.examples import EXAMPLES
    from kfit.runtime.atomic_write import atomic_write

    folder = Path(args.out)
    example = EXAMPLES[0]
    photo, mask = atomic_write(
        folder, {f"{example.name}.png": example.save_photo, f"{example.name}_mask.png": example.save_mask}
    )
    words = [str(photo), "--category", example.category, "--mask", str(mask), "--out", str(folder), "--open"]
    chosen = pose.parser().parse_args(words)
    log.info("this is %s", pose.command(chosen))
    pose.run(chosen)
