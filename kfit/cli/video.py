"""Follow an object through a video.

Writes poses.json and overlay.webm, and prints one line.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from jsonargparse import ArgumentParser, Namespace

from kfit.cli.object_arguments import camera_of, check_thing
from kfit.cli.video_summary import VideoSummary
from kfit.runtime.console import log, progress, status

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from kfit.pose import CategoryModel, PoseResult
    from kfit.reports import VideoFile
    from kfit.segmentation import Frame, Frames
    from kfit.tracking import TrackedPose


def parser() -> ArgumentParser:
    """Arguments of ``kfit video``."""
    parser = ArgumentParser(
        description="Follow one object through a video, each frame from the last one's pose, which is much faster than "
        "fitting frames one by one: writes DIR/poses.json, a pose for each frame, and DIR/overlay.webm, a video that "
        "shows them, and prints one line.",
        epilog="""examples:
  kfit video clip.mp4 --category mug --box 120 80 300 260
  kfit video frames/ --category mug --masks masks/""",
    )
    parser.add_argument("frames", type=str, help="a video file, or a folder of pictures numbered by their names")
    parser.add_argument("--category", type=str, default=None, help="kind of object: a bundled model's name")
    parser.add_argument(
        "--model", type=str, default=None, help="a .safetensors model of your own, instead of --category"
    )
    parser.add_argument(
        "--mask", type=str, default=None, help="a picture of the first frame's size, light on the object"
    )
    parser.add_argument(
        "--masks",
        type=str,
        default=None,
        metavar="FOLDER",
        help="a mask for each frame, numbered by their names; all 0 where the object is not visible",
    )
    parser.add_argument(
        "--box",
        type=float,
        nargs=4,
        default=None,
        metavar=("X", "Y", "W", "H"),
        help="tight box around the object in the first frame, in pixels",
    )
    parser.add_argument(
        "--segmenter",
        type=str,
        default=None,
        metavar="FILE.onnx",
        help="a network that finds the object in the first frame, as for kfit pose",
    )
    parser.add_argument(
        "--intrinsics",
        type=float,
        nargs=4,
        default=None,
        metavar=("FX", "FY", "CX", "CY"),
        help="camera in pixels; else by the first frame's EXIF tags, else the focal length is estimated",
    )
    parser.add_argument("--out", type=str, default="kfit_out", help="folder to write to", metavar="DIR")
    parser.add_argument("--seed", type=int, default=0, help="seed of the random numbers")
    return parser


def run(args: Namespace) -> None:
    """Follow, write the two files, and print."""
    check_thing(args)
    named = [name for name in ("mask", "masks", "box", "segmenter") if args[name] is not None]
    if len(named) > 1 and named != ["box", "segmenter"]:
        raise ValueError(f"--{named[0]} and --{named[1]} were both given; use one of them to select the object")
    with status("Loading kfit …"):
        from kfit.models import load
        from kfit.runtime.atomic_write import atomic_write
        from kfit.segmentation import Frames

        frames = Frames.of(args.frames)
        video = Video(load(args.model or args.category), frames, args)
    # Both files grow from frame to frame, and are written together.
    files = {"overlay.webm": lambda path: video.write(path, path.with_name("poses.json")), "poses.json": lambda _: None}
    overlay, _ = atomic_write(Path(args.out), files)
    if frames.note:
        log.info("%s", frames.note)
    print(f"{video.summary.sentence(video.model.card.category)} · {overlay}")


class Video:
    """An object on its way through a video.

    Args:
        model: with a pose head.
        frames: frames of the video.
        args: arguments of the command line.

    Attributes:
        summary: what was found so far.
    """

    def __init__(self, model: CategoryModel, frames: Frames, args: Namespace) -> None:
        from kfit.segmentation import pictures
        from kfit.tracking.track_confidence import pose_head_of

        pose_head_of(model)  # refused before the first frame is fitted
        self.model, self.frames, self.args = model, frames, args
        self.summary = VideoSummary()
        self.masks = None if args.masks is None else pictures(Path(args.masks))
        if self.masks is not None and Path(args.frames).is_dir() and len(self.masks) != frames.count:
            raise ValueError(f"--masks: {args.masks} holds {len(self.masks)} masks for {frames.count} frames")

    def write(self, overlay: Path, poses: Path) -> None:
        """Write the video and the poses, frame by frame."""
        from concurrent.futures import Future, ThreadPoolExecutor

        from kfit.reports import VideoFile

        begun = time.perf_counter()
        with (
            poses.open("w", buffering=1) as file,  # written frame by frame, so that a full disk ends it early
            VideoFile(overlay, self.frames.rate) as video,
            # A frame is drawn and encoded while the next is followed.
            ThreadPoolExecutor(1) as drawing,
            progress() as bar,
        ):
            task = bar.add_task("following", total=self.frames.count)
            shown: Future[None] | None = None
            for number, (frame, answer) in enumerate(self.tracked(file)):
                file.write(f"{',' if number else ''}\n  {json.dumps(entry(number, frame, answer))}")
                if shown is not None:
                    shown.result()
                shown = drawing.submit(self.show, video, frame, answer, number)
                self.summary.add(answer)
                bar.advance(task)
            if shown is not None:
                shown.result()
            file.write(f'\n], "summary": {json.dumps(self.summary.to_dict())}}}\n')
        self.summary.seconds = time.perf_counter() - begun

    def tracked(self, file: TextIO) -> Iterator[tuple[Frame, TrackedPose]]:
        """Yield the frames and their poses; values from the first that hold for all are written before."""
        from kfit.segmentation import mask_from_alpha
        from kfit.tracking import Tracker

        tracker: Tracker | None = None
        for number, frame in enumerate(self.frames):
            mask = self.mask(number, frame)
            if tracker is None:
                result = self.first(frame, mask)
                for note in result.notes:
                    log.info("%s", note)
                file.write(json.dumps(header(result))[:-1] + ', "frames": [')
                tracker = Tracker(self.model, result, self.args.seed)
                yield frame, tracker.last
            else:
                yield frame, tracker(frame.photo, mask_from_alpha(frame.photo.alpha) if mask is None else mask)

    def mask(self, number: int, frame: Frame) -> NDArray[np.float32] | None:
        """Return the mask of a frame, or None where none was given for it."""
        from kfit.segmentation import mask_from_file

        shape = frame.photo.image.shape[:2]
        if self.masks is not None:
            # The number of frames in a clip's header is approximate.
            if number >= len(self.masks):
                held = f"{self.args.masks} holds {number} masks"
                raise ValueError(f"--masks: {held}, and {self.args.frames} has more frames")
            return mask_from_file(self.masks[number], shape, may_be_empty=number > 0)
        return mask_from_file(self.args.mask, shape) if self.args.mask is not None and number == 0 else None

    def first(self, frame: Frame, mask: NDArray[np.float32] | None) -> PoseResult:
        """The answer to the first frame."""
        args = self.args
        box = None if args.box is None else tuple(args.box)
        return self.model.pose(frame.photo, mask, box, camera_of(args), segmenter=args.segmenter, seed=args.seed)

    def show(self, video: VideoFile, frame: Frame, answer: TrackedPose, number: int) -> None:
        """Add a frame to the video."""
        from kfit.reports import draw_frame
        from kfit.reports.words import confidence_words, length

        words = [self.model.card.category, f"frame {number}"]
        words.append(f"about {length(float(answer.translation[2]))} away" if answer.found else "not found")
        words += [confidence_words(answer.confidence)] if answer.found else []
        words += ["found anew"] if answer.anew and number > 0 else []
        pose = (answer.rotation, answer.translation, answer.size, answer.intrinsics) if answer.found else None
        outline = (answer.silhouette, answer.crop) if answer.found else None
        confidence = answer.confidence if answer.found else None
        video.write(draw_frame(frame.photo.image, ", ".join(words), pose, outline, confidence))


def header(first: PoseResult) -> dict[str, Any]:
    """What holds for all frames."""
    answer = first.to_dict()
    return {name: answer[name] for name in ("category", "symmetry", "intrinsics", "intrinsics_from", "notes")}


def entry(number: int, frame: Frame, answer: TrackedPose) -> dict[str, Any]:
    """Return the entry of a frame in ``poses.json``; None if the object was not found."""
    numbers = {name: getattr(answer, name).tolist() for name in ("rotation", "translation", "size")}
    return {
        "frame": number,
        "time": frame.time,
        "found": answer.found,
        "anew": answer.anew,
        **(numbers if answer.found else dict.fromkeys(numbers)),
        "energy": answer.energy if answer.found else None,
        "confidence": answer.confidence,
        "overlap": answer.overlap,
    }
