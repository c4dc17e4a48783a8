"""Draw a category's training objects from four sides, to check their axes before a training."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from jsonargparse import ArgumentParser, Namespace

from kfit.runtime.console import log, see_working_folder

if TYPE_CHECKING:
    from kfit.data import Light, Mesh
    from kfit.geometry import Category


def parser() -> ArgumentParser:
    """Arguments of ``kfit views``."""
    parser = ArgumentParser(
        description="Draw objects of a category from four sides onto a sheet: y must point up, and the front, the "
        "category's +x, where the headings say. Files that are not read and lost textures are listed.",
        epilog="examples:\n  kfit views --category mug --meshes scans@z --show sheet.png\n"
        "  kfit views --category teapot.yaml --meshes '[teapots@y,-z,teapots/odd.stl@z]' --show sheet.png",
    )
    parser.add_argument(
        "--category",
        type=str,
        default="mug",
        help="a name, a .yaml file with the fields of kfit.geometry.Category, or the import path of one",
    )
    parser.add_argument(
        "--meshes",
        type=list[str] | str,
        default=[],
        metavar="[PLACE,…]",
        help="mesh files and folders of them, written as for --data.meshes (default: procedural objects)",
    )
    parser.add_argument("--objects", type=int, default=12, help="largest number of objects")
    parser.add_argument("--show", type=str, required=True, metavar="FILE.png", help="picture to write")
    return parser


def run(args: Namespace) -> None:
    """Draw the sheet, and list what was read."""
    if args.objects < 1:
        raise ValueError(f"--objects must be at least 1, got {args.objects}")
    show = Path(args.show)
    if show.suffix.lower() not in (".png", ".jpg", ".jpeg"):
        raise ValueError(f"--show must name a .png or .jpg file, got {args.show}")
    import cv2

    from kfit.data import read_category
    from kfit.reports.object_sheet import object_sheet
    from kfit.runtime.atomic_write import atomic_write

    see_working_folder()
    category = read_category(args.category)
    sheet = object_sheet(_objects(category, args), f"{category.name}: {category.axes}")
    done, content = cv2.imencode(show.suffix, sheet[..., ::-1])
    if not done:
        raise ValueError(f"--show {args.show} cannot be encoded")
    (path,) = atomic_write(show.parent, {show.name: partial(_write, content=content.tobytes())})
    log.info("wrote %s", path)


def _objects(category: Category, args: Namespace) -> Iterator[tuple[str, Mesh, Light]]:
    import numpy as np

    from kfit.data import Light, shapes
    from kfit.data.exposure import with_exposure
    from kfit.data.mesh_places import find_mesh_files

    if not args.meshes:
        for number in range(args.objects):
            yield f"object {number}", *shapes.build(category, number)
        return
    files = find_mesh_files(args.meshes, [category.name])
    if len(files) > args.objects:
        log.info("drawing %d of %d meshes; --objects changes that", args.objects, len(files))
    for file in files[: args.objects]:
        mesh = with_exposure(file.mesh(), two_sided=None)
        name = "/".join(file.path.parts[-2:])  # many files of folders for each object are called model.obj
        yield f"{name}, up {file.up}, front {file.front}", mesh, Light.random(np.random.default_rng(0))


def _write(path: Path, content: bytes) -> None:
    path.write_bytes(content)
