"""Arguments of `kfit pose`."""

from __future__ import annotations

from jsonargparse import ArgumentParser

from kfit.cli.category_names import SPOKEN
from kfit.cli.photo_files import path_name


def _number(value: str | list[float]) -> float | list[float]:
    """Return a number; jsonargparse checks the length of a box."""
    return list(map(float, value)) if isinstance(value, list) else float(value)


def parser() -> ArgumentParser:
    """Arguments of ``kfit pose``."""
    parser = ArgumentParser(
        description="Find the poses of the bottles, bowls, cameras, cans, laptops and mugs in a photo, without CAD "
        "models of them: writes DIR/pose.json and DIR/overlay.png and prints a line, or a table of several objects.",
        epilog="""examples:
  kfit pose photo.jpg --open
  kfit pose photo.jpg --category mug --box 120 80 300 260
  kfit pose holiday/ --category cup --segmenter yolo11n-seg.onnx
  kfit pose cutout.png --category laptop --intrinsics 1450 1450 960 540 --json
  kfit pose left.jpg right.jpg --relative-poses poses.json --intrinsics 1450 1450 960 540""",
    )
    parser.add_argument(
        "photo",
        type=path_name,
        nargs="+",
        help="picture files, or folders of them; an alpha channel, if any, selects the object",
    )
    thing = parser.add_argument_group("the object, unless all are meant")
    thing.add_argument(
        "--category", type=str, default=None, metavar="NAME", help=f"search for this category only, one of {SPOKEN}"
    )
    thing.add_argument(
        "--model", type=str, default=None, metavar="FILE.safetensors", help="a model of your own, instead of --category"
    )
    thing.add_argument(
        "--mask",
        type=str,
        action="append",
        default=None,
        metavar="FILE",
        help="a picture of the photo's size, light on the object (default: the photo's alpha channel); for "
        "several photos, repeat --mask in their order",
    )
    thing.add_argument(
        "--box",
        type=_number,
        nargs=4,
        action="append",
        default=None,
        metavar=("X", "Y", "W", "H"),
        help="box around the object in pixels; for several photos, repeat --box in their order",
    )
    thing.add_argument(
        "--ignore",
        type=str,
        default=None,
        metavar="FILE",
        help="a picture of the photo's size, light where something else hides the object; it does not count there",
    )
    thing.add_argument("--pick", action="store_true", help="list the objects found, and ask which to fit")
    thing.add_argument(
        "--segmenter",
        type=str,
        default=None,
        metavar="FILE.onnx",
        help="your own network to find objects, instead of kfit's: Mask R-CNN or YOLO-seg, or U²-Net or IS-Net, which "
        "segment salient objects",
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
        "--relative-poses",
        type=str,
        default=None,
        metavar="FILE.json",
        help="the photos show one object, and the file holds a list of 4 x 4 matrices, one for each photo: from the "
        "first camera to each, in metres (x right, y down, z forward), the identity first; they fix distance and size",
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
        help="fit by a recipe, such as recipes/fit_released.yaml (default: kfit's own fit); a recipe names Python "
        "classes, so run only recipes that you trust",
    )
    fit.add_argument("--device", type=str, default="cpu", help="cpu, cuda or another name of PyTorch's")
    fit.add_argument(
        "--precision",
        type=str,
        default="32",
        choices=["32", "bf16"],
        help="bf16 computes convolutions in bfloat16: a fifth faster on a CPU that has it; poses differ by about 0.1°",
    )
    fit.add_argument("--seed", type=int, default=0, help="seed of the random numbers")
    output = parser.add_argument_group("output")
    output.add_argument("--out", type=str, default="kfit_out", help="folder to write to", metavar="DIR")
    output.add_argument(
        "--open",
        action="store_true",
        help="show the answer in a browser: the page of --report, DIR/report.html unless named, or the pictures of "
        "several objects",
    )
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
