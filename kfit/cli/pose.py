"""Find the poses of the objects in photos.

Writes pose.json and a picture, and prints a line or a table.
"""

from __future__ import annotations

import json
import shlex
import sys
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jsonargparse import Namespace

from kfit.cli.category_names import named_category
from kfit.cli.object_arguments import camera_of
from kfit.cli.photo_files import photo_files
from kfit.cli.pose_arguments import parser
from kfit.cli.pose_views import answer_views, read_poses
from kfit.runtime.console import log, progress, see_working_folder, status, table_console

if TYPE_CHECKING:
    from kfit.pose import CategoryModel, PoseResult
    from kfit.pose.object_finder import FoundObject
    from kfit.segmentation import Photo

__all__ = ["command", "parser", "run"]
# Width of the table if stdout is not a terminal.
WIDTH = 160


def run(args: Namespace) -> None:
    """Answer, write the files, and print."""
    photos = photo_files(args.photo)
    _check(args, photos)
    with status("Loading kfit …"):
        from kfit.models import load
        from kfit.pose.object_finder import ObjectFinder
        from kfit.pose.targets import find_targets
        from kfit.runtime.devices import device_of, precision
        from kfit.segmentation import depth_from_file, load_segmenter, mask_from_file, read_photo

    if args.animation is not None:
        from kfit.reports.animation import check_suffix

        check_suffix(args.animation)
    if args.mesh is not None:
        from kfit.reports.mesh_file import check_mesh_suffix

        check_mesh_suffix(args.mesh)
    own = None if args.model is None else load(args.model)
    category = own.card.category if own is not None else args.category and named_category(args.category)
    poses = None if args.relative_poses is None else read_poses(args.relative_poses, len(photos))
    segmenter = None if args.segmenter is None else load_segmenter(args.segmenter)
    device, finder, loaded = device_of(args.device), ObjectFinder(), lru_cache(load)

    def model_of(name: str) -> CategoryModel:
        return (own or loaded(name)).to(device)

    def found(number: int, photo: Photo) -> list[FoundObject]:
        name = photos[number]
        try:
            mask = None if args.mask is None else mask_from_file(args.mask[number], photo.image.shape[:2])
            box = None if args.box is None else tuple(args.box[number])
            with status(f"Looking for objects in {name} …") if len(photos) == 1 else nullcontext():
                targets = find_targets(photo, category, mask, box, segmenter, finder)
        except (ValueError, OSError) as error:
            if len(photos) == 1 or name in str(error):
                raise
            raise ValueError(f"{name}: {error}") from error
        return _picked(targets) if args.pick else targets

    if args.fit is not None:
        from kfit.geometry import CATEGORIES
        from kfit.pose.fit_recipe import fit_of

        # A mistake in the recipe ends the command before any photo is read.
        see_working_folder()
        fit_of(args.fit, model_of(category or next(iter(CATEGORIES))))
    answers: dict[str, list[PoseResult]] = {}
    with progress() as bar, precision(args.precision, device):
        if poses is not None:
            views = [(photo, found(number, photo)) for number, photo in enumerate(map(read_photo, photos))]
            answers[photos[0]] = [answer_views(args, photos, views, poses, model_of)]
            _report(args, answers)
            return
        for number, name in enumerate(bar.track(photos, description="Photos") if len(photos) > 1 else photos):
            try:
                photo = read_photo(name)
                depth = None if args.depth is None else depth_from_file(args.depth, photo.image.shape[:2])
                ignore = None if args.ignore is None else mask_from_file(args.ignore, photo.image.shape[:2])
                targets = found(number, photo)
                _check_one(args, targets)
                answers[name] = [
                    _answer(args, model_of(target.category), photo, target, depth, ignore, len(photos))
                    for target in targets
                ]
            except (ValueError, OSError) as error:
                if len(photos) == 1:
                    raise
                log.warning("%s", str(error) if name in str(error) else f"{name}: {error}")
    _report(args, answers)


def _check(args: Namespace, photos: Sequence[str]) -> None:
    """Refuse arguments that exclude one another.

    Raises:
        ValueError: naming them.
    """
    if args.category is not None and args.model is not None:
        raise ValueError("--category and --model were both given; a model has its own category")
    if args.model is not None and not args.model.endswith(".safetensors"):
        raise ValueError(f"--model must name a .safetensors file, got {args.model}")
    if args.mask is not None and (args.box is not None or args.segmenter is not None):
        other = "--segmenter" if args.box is None else "--box"
        raise ValueError(f"--mask and {other} were both given; use one of them to select the object")
    if args.fit is not None and args.depth is not None:
        raise ValueError("--fit and --depth were both given; a recipe fits colour alone")
    if args.report is not None and Path(args.report).suffix.lower() not in (".html", ".htm"):
        raise ValueError(f"--report must name an .html file, got {args.report!r}")
    for option in ("mask", "box"):
        if args[option] is not None and len(args[option]) != len(photos):
            raise ValueError(f"--{option} must be given once for each of {len(photos)} photos, got {len(args[option])}")
    several = args.relative_poses is not None
    if several and len(photos) < 2:
        raise ValueError("--relative-poses is of several photos of one object, but 1 photo was given")
    if several and args.fit is not None:
        raise ValueError("--fit and --relative-poses were both given; a recipe fits one photo")
    for option in ("depth", "ignore") if several else ("depth", "ignore", "report", "animation", "mesh"):
        if args[option] is not None and len(photos) > 1:
            raise ValueError(f"--{option} is of one photo, but {len(photos)} were given")


def _check_one(args: Namespace, targets: Sequence[FoundObject]) -> None:
    for option in ("report", "animation", "mesh"):
        if args[option] is not None and len(targets) > 1:
            raise ValueError(
                f"--{option} shows one object, but {len(targets)} were found; select one by --category, --box or --pick"
            )


def _picked(targets: Sequence[FoundObject]) -> list[FoundObject]:
    """Those that a person chooses in the terminal.

    Raises:
        ValueError: if stdin has no answer, or another than numbers of the list.
    """
    for number, target in enumerate(targets, 1):
        print(f"{number}  {target.words}, box {_spelled(target.box)}", file=sys.stderr)
    if not targets:
        return []
    print("Which? Numbers, or Enter for all: ", end="", file=sys.stderr, flush=True)
    words = sys.stdin.readline().replace(",", " ").split()
    if not all(word.isdecimal() and 1 <= int(word) <= len(targets) for word in words):
        raise ValueError(f"--pick takes numbers from 1 to {len(targets)}, got {' '.join(words)!r}")
    return [targets[int(word) - 1] for word in dict.fromkeys(words)] or list(targets)


def _answer(
    args: Namespace, model: CategoryModel, photo: Photo, target: FoundObject, depth: Any, ignore: Any, num_photos: int
) -> PoseResult:
    """The pose of one object, with its notes in the log."""
    from kfit.callbacks import Progress
    from kfit.models.find_poses import pose_of

    log.info("found a %s in box %s", target.words, _spelled(target.box))
    fit = None
    if args.fit is not None:
        from kfit.pose.fit_recipe import fit_of

        fit = fit_of(args.fit, model)
    watching = [Progress()] if num_photos == 1 else []
    result = pose_of(model, photo, target, camera_of(args), depth, args.seed, fit, watching, ignore)
    for note in result.notes:
        log.info("%s", note)
    return result


def _spelled(box: Sequence[float]) -> str:
    return " ".join(f"{part:.0f}" for part in box)


def _report(args: Namespace, answers: dict[str, list[PoseResult]]) -> None:
    """Write the files and print the line, the table or the JSON.

    Raises:
        ValueError: if nothing was found at all.
    """
    results = [result for found in answers.values() for result in found]
    if not results:
        what = args.category or "bottle, bowl, camera, can, laptop or mug"
        where = args.photo[0] if len(args.photo) == 1 else "the photos"
        raise ValueError(f"no {what} was found in {where}; point at one by --box X Y W H or --mask FILE")
    from kfit.cli import answer_files
    from kfit.reports import describe
    from kfit.runtime.browser import open_files

    if args.open and args.report is None and len(results) == 1:
        args.report = str(Path(args.out) / "report.html")
    pictures = answer_files.write(answers, Path(args.out), pages(results, args))
    if args.json:
        print(json.dumps(answer_files.document(answers)))
    elif len(results) == 1:
        print(f"{describe(results[0])} · {pictures[0]}")
    else:
        table_console(WIDTH).print(answer_files.table(answers))
        print(*pictures, sep="\n")
    if args.open:
        open_files([Path(args.report)] if args.report is not None else pictures)


def pages(results: Sequence[PoseResult], args: Namespace) -> dict[str, Callable[[Path], object]]:
    """Return the writers of the requested page, animation and mesh of one answer, by absolute path."""
    writers: dict[str, Callable[[Path], object]] = {}
    if args.report is not None:
        from kfit.reports.html_page import report

        writers[str(Path(args.report).absolute())] = partial(report, results[0], command=command(args))
    if args.animation is not None:
        from kfit.reports.animation import animate

        writers[str(Path(args.animation).absolute())] = partial(animate, results[0])
    if args.mesh is not None:
        from kfit.reports.mesh_file import write_mesh

        writers[str(Path(args.mesh).absolute())] = partial(write_mesh, results[0], suffix=Path(args.mesh).suffix)
    return writers


def command(args: Namespace) -> str:
    """The command line that repeats an answer, with what differs from the defaults."""
    defaults = parser().get_defaults()
    words = ["kfit", "pose", *args.photo]
    for option, value in args.items():
        if option in defaults and option != "photo" and value != defaults[option]:
            for one in value if option in ("mask", "box") else [value]:
                words.append(f"--{option.replace('_', '-')}")
                words += [] if one is True else [f"{part:g}" for part in one] if isinstance(one, list) else [str(one)]
    return shlex.join(words)
