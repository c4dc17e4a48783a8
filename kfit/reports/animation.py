"""A fit as an animation: the observation, and the drawing step by step."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from kfit.pose import PoseResult
from kfit.reports.fit_frames import FitFrames, Picture, fit_frames
from kfit.reports.video_file import VideoFile
from kfit.runtime.atomic_write import atomic_write

SUFFIXES = (".gif", ".mp4")
SIDE, GAP, LINE = 256, 8, 36
INK, GREY, PAPER, DONE = (27, 27, 31), (107, 114, 128), (255, 255, 255), (255, 176, 0)
# Steps a second, and seconds for which the last is shown.
RATE, LAST_SECONDS = 8, 2


def check_suffix(path: str | Path) -> None:
    """Raise a ValueError unless it is the name of a GIF or MP4 file."""
    if Path(path).suffix.lower() not in SUFFIXES:
        raise ValueError(f"animation must be a .gif or .mp4 file, got {str(path)!r}")


def animate(result: PoseResult, path: str | Path) -> Path:
    """Write an animation whose frames are the steps; an MP4, in VP9, repeats the last for two seconds.

    Args:
        result: result for a photo.
        path: ends in .gif or .mp4.

    Raises:
        ValueError: for a path that that ends otherwise.
        OSError: if the video cannot be written.
    """
    check_suffix(path)
    place = Path(path)
    pictures = _pictures(fit_frames(result))
    write = _write_gif if place.suffix.lower() == ".gif" else _write_mp4
    return atomic_write(place.parent, {place.name: lambda aside: write(pictures, aside)})[0]


def _pictures(frames: FitFrames) -> list[Image.Image]:
    observed, last = _panel(frames.observed), len(frames.drawings) - 1
    font = ImageFont.load_default(size=16)
    pictures = []
    for step, drawing in enumerate(frames.drawings):
        picture = Image.new("RGB", (2 * SIDE + GAP, SIDE + LINE), PAPER)
        picture.paste(observed, (0, 0))
        picture.paste(_panel(drawing), (SIDE + GAP, 0))
        pen = ImageDraw.Draw(picture)
        pen.text((GAP, SIDE + LINE / 2), "seen", INK, font, anchor="lm")
        pen.text((SIDE + 2 * GAP, SIDE + LINE / 2), f"step {step} of {last}", INK, font, anchor="lm")
        energy = f"energy {frames.energy[step]:.2f}"
        pen.text((2 * SIDE, SIDE + LINE / 2), energy, GREY, font, anchor="rm")
        pen.rectangle((0, SIDE + LINE - 4, picture.width * (step + 1) / (last + 1) - 1, SIDE + LINE - 1), DONE)
        pictures.append(picture)
    return pictures


def _panel(picture: Picture) -> Image.Image:
    return Image.fromarray(picture).resize((SIDE, SIDE), Image.Resampling.BICUBIC)


def _write_gif(pictures: list[Image.Image], path: Path) -> None:
    shown = [1000 // RATE] * (len(pictures) - 1) + [1000 * LAST_SECONDS]
    pictures[0].save(path, save_all=True, append_images=pictures[1:], duration=shown, loop=0)


def _write_mp4(pictures: list[Image.Image], path: Path) -> None:
    with VideoFile(path, RATE) as video:
        for picture in [*pictures, *[pictures[-1]] * (LAST_SECONDS * RATE - 1)]:
            video.write(np.asarray(picture))
