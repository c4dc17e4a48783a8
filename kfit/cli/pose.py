"""Find the pose of an object in a photo.

Writes pose.json and overlay.png, and prints one line.
"""

from __future__ import annotations

import json
import shlex
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from jsonargparse import ArgumentParser, Namespace

from kfit.cli.object_arguments import camera_of, check_thing
from kfit.runtime.console import log, see_working_folder

if TYPE_CHECKING:
    from kfit.pose import PoseResult


def parser() -> ArgumentParser:
    """Arguments of ``kfit pose``."""
    parser = ArgumentParser(
        description="Find the pose of an object in a photo, without a CAD model of it: writes DIR/pose.json and "
        "DIR/overlay.png and prints one line.",
        epilog="""examples:
  kfit pose photo.jpg --category mug --box 120 80 300 260
  kfit pose photo.jpg --category mug --segmenter yolo11n-seg.onnx
  kfit pose cutout.png --category laptop --intrinsics 1450 1450 960 540 --json""",
    )
    parser.add_argument("photo", type=str, help="a picture file; its alpha channel, if any, tells where the object is")
    thing = parser.add_argument_group("what and where the object is")
    thing.add_argument(
        "--category",
        type=str,
        default=None,
        metavar="NAME",
        help="kind of object, a bundled model: bottle, bowl, camera, can, laptop or mug; needed without --model",
    )
    thing.add_argument(
        "--model", type=str, default=None, metavar="FILE.safetensors", help="a model of your own, instead of --category"
    )
    thing.add_argument(
        "--mask",
        type=str,
        default=None,
        metavar="FILE",
        help="a picture of the photo's size, light on the object (default: the photo's alpha channel)",
    )
    thing.add_argument(
        "--box",
        type=float,
        nargs=4,
        default=None,
        metavar=("X", "Y", "W", "H"),
        help="tight box around the object in pixels; GrabCut or the segmenter finds the object in it",
    )
    thing.add_argument(
        "--segmenter",
        type=str,
        default=None,
        metavar="FILE.onnx",
        help="a network that finds the object: Mask R-CNN or YOLO-seg (without --box, the surest of the category) or "
        "IS-Net (best with --box)",
    )
    camera = parser.add_argument_group("camera")
    camera.add_argument(
        "--intrinsics",
        type=float,
        nargs=4,
        default=None,
        metavar=("FX", "FY", "CX", "CY"),
        help="focal lengths and centre in pixels (default: by the photo's EXIF tags, else estimated)",
    )
    camera.add_argument(
        "--depth",
        type=str,
        default=None,
        metavar="FILE",
        help="depth in the photo's pixels, a 16-bit picture of millimetres or metres in a .npy file; it fixes "
        "distance and size",
    )
    fit = parser.add_argument_group("fit")
    fit.add_argument(
        "--fit",
        type=str,
        default=None,
        metavar="RECIPE.yaml",
        help="fit as a recipe says, such as recipes/fit_released.yaml (default: kfit's own way); a recipe names Python "
        "classes, so run one only of whom you trust, like a program",
    )
    fit.add_argument("--device", type=str, default="cpu", help="cpu, cuda or whatever PyTorch calls it")
    fit.add_argument(
        "--precision",
        type=str,
        default="32",
        choices=["32", "bf16"],
        help="bf16 draws by bfloat16 convolutions, a fifth faster on a CPU that has them; poses differ by 0.1° or so",
    )
    fit.add_argument("--seed", type=int, default=0, help="decides the random numbers")
    output = parser.add_argument_group("output")
    output.add_argument("--out", type=str, default="kfit_out", help="folder to write to", metavar="DIR")
    output.add_argument("--json", action="store_true", help="print the JSON instead of the line")
    output.add_argument(
        "--report", type=str, default=None, metavar="FILE.html", help="write a page about the fit as well"
    )
    output.add_argument(
        "--animation",
        type=str,
        default=None,
        metavar="FILE.gif|FILE.mp4",
        help="write what the drawing became from step to step as well",
    )
    output.add_argument(
        "--mesh",
        type=str,
        default=None,
        metavar="FILE.glb|FILE.obj|FILE.ply",
        help="write the fitted object's surface as well, in metres about its centre",
    )
    return parser


def run(args: Namespace) -> None:
    """Answer, write the files, and print."""
    check_thing(args)
    if args.mask is not None and (args.box is not None or args.segmenter is not None):
        other = "--segmenter" if args.box is None else "--box"
        raise ValueError(f"--mask and {other} were both given; the object is told by one of them")
    if args.fit is not None and args.depth is not None:
        raise ValueError("--fit and --depth were both given; a recipe fits colour alone")
    if args.report is not None and Path(args.report).suffix.lower() not in (".html", ".htm"):
        raise ValueError(f"--report must name an .html file, got {args.report!r}")
    from kfit.models import load
    from kfit.segmentation import depth_from_file, mask_from_file, read_photo

    model = load(args.model or args.category)
    photo = read_photo(args.photo)
    mask = None if args.mask is None else mask_from_file(args.mask, photo.image.shape[:2])
    depth = None if args.depth is None else depth_from_file(args.depth, photo.image.shape[:2])
    camera = camera_of(args)
    if args.animation is not None:
        from kfit.reports.animation import check_suffix

        check_suffix(args.animation)
    if args.mesh is not None:
        from kfit.reports.mesh_file import check_mesh_suffix

        check_mesh_suffix(args.mesh)
    from kfit.callbacks import Progress
    from kfit.runtime.devices import device_of, precision

    model.to(device := device_of(args.device))
    if args.fit is None:
        lens_known = camera is not None or photo.intrinsics is not None
        pipeline = model.pipeline(depth=depth is not None, lens_known=lens_known)
    else:
        from kfit.pose.fit_recipe import fit_of

        see_working_folder()
        pipeline = fit_of(args.fit, model)
    pipeline.callbacks.append(Progress())
    box = None if args.box is None else tuple(args.box)
    with precision(args.precision, device):
        result = model.pose(
            photo,
            mask=mask,
            box=box,
            intrinsics=camera,
            depth=depth,
            segmenter=args.segmenter,
            seed=args.seed,
            pipeline=pipeline,
        )
    for note in result.notes:
        log.info("%s", note)
    from kfit.reports import describe

    overlay = write(result, Path(args.out), pages(result, args))
    print(json.dumps(result.to_dict()) if args.json else f"{describe(result)} · {overlay}")


def pages(result: PoseResult, args: Namespace) -> dict[str, Callable[[Path], object]]:
    """What writes the page, the animation and the mesh that were asked for, by absolute path."""
    writers: dict[str, Callable[[Path], object]] = {}
    if args.report is not None:
        from kfit.reports.html_page import report

        writers[str(Path(args.report).absolute())] = partial(report, result, command=command(args))
    if args.animation is not None:
        from kfit.reports.animation import animate

        writers[str(Path(args.animation).absolute())] = partial(animate, result)
    if args.mesh is not None:
        from kfit.reports.mesh_file import write_mesh

        writers[str(Path(args.mesh).absolute())] = partial(write_mesh, result, suffix=Path(args.mesh).suffix)
    return writers


def command(args: Namespace) -> str:
    """The command line that repeats an answer, with what differs from the defaults."""
    defaults = parser().get_defaults()
    words = ["kfit", "pose", args.photo]
    for option, value in args.items():
        if option in defaults and option != "photo" and value != defaults[option]:
            words.append(f"--{option}")
            words += (
                [] if value is True else [f"{part:g}" for part in value] if isinstance(value, list) else [str(value)]
            )
    return shlex.join(words)


def write(result: PoseResult, folder: Path, others: Mapping[str, Callable[[Path], object]]) -> Path:
    """Write pose.json, overlay.png and others by absolute path, all or none; the path of overlay.png."""
    import torch
    from skimage.io import imsave

    from kfit.reports import describe, draw_overlay
    from kfit.runtime.atomic_write import atomic_write

    rotation, translation, size, camera = (
        torch.from_numpy(part) for part in (result.rotation, result.translation, result.size, result.intrinsics)
    )
    picture = draw_overlay(
        result.image,
        rotation,
        translation,
        size,
        camera,
        seen=result.observation.field("image")[0],
        drawing=torch.from_numpy(result.drawing).movedim(-1, 0),
        mask=result.mask,
        caption=describe(result),
    )
    _, overlay, *_ = atomic_write(
        folder,
        {
            "pose.json": lambda path: path.write_text(json.dumps(result.to_dict(), indent=2) + "\n"),
            "overlay.png": lambda path: imsave(path, picture, check_contrast=False),
            **others,
        },
    )
    return overlay
