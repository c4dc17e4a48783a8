"""Register ten pictures with their warped, darkened and noisy twins, by kfit and by its rivals."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from typing import TYPE_CHECKING

from jsonargparse import ArgumentParser, Namespace

from kfit.bench.accuracy import command
from kfit.bench.accuracy_page import Section
from kfit.bench.page import show, write_page
from kfit.bench.registration_pairs import PICTURES, Pair, corner_distance, make_pair, noise_floor
from kfit.runtime.console import log, progress

if TYPE_CHECKING:
    from torch import Tensor

# Mean distance of the corners, in pixels, beyond which a pair is lost.
LOST = 1.0


def parser() -> ArgumentParser:
    """Arguments of ``kfit bench registration``."""
    parser = ArgumentParser(
        description="Register ten pictures of scikit-image with their twins: warped by a known homography (roll up to "
        "8°, shift up to 6 %, scale up to 8 %, each corner up to another 2 %), brightness · gain + bias, noise. Prints "
        "for each picture the mean distance in pixels between where the corners are taken and where they belong, and "
        "the seconds: kfit.register, Kornia's ImageRegistrator and OpenCV's findTransformECC with their default "
        "settings (ECC with up to 500 iterations), ECC without its blur, and, where it is installed, SimpleITK (affine "
        "maps by correlation, for it has no homographies). The "
        "floor is the distance (root mean square) that the noise alone leaves to the best unbiased method, the "
        "Cramér–Rao bound: what lies closer together than that may stand in either order by chance.",
        epilog="example:\n  kfit bench registration --pictures '[coffee,coins]' --draws 3",
    )
    parser.add_argument(
        "--pictures",
        type=list[str],
        default=list(PICTURES),
        metavar="[NAME,…]",
        help="names in skimage.data (default: all ten)",
    )
    parser.add_argument(
        "--motion",
        type=str,
        default="homography",
        choices=["homography", "affine"],
        help="kind of the known maps, and what kfit and ECC look for",
    )
    parser.add_argument("--size", type=int, default=192, help="width of the pictures in pixels, a multiple of 8")
    parser.add_argument("--noise", type=float, default=0.02, help="standard deviation of the noise, of a range of 1")
    parser.add_argument("--draws", type=int, default=1, help="pairs of each picture; the table shows their medians")
    parser.add_argument("--seed", type=int, default=0, help="chooses maps, brightness and noise")
    parser.add_argument("--out", type=str, default=None, metavar="DIR", help="write README.md there (default: nowhere)")
    return parser


def run(args: Namespace) -> None:
    """Register, and print the table."""
    unknown = sorted(set(args.pictures) - set(PICTURES))
    if unknown or not args.pictures:
        raise ValueError(f"--pictures: unknown {', '.join(unknown) or 'nothing'}; known are {', '.join(PICTURES)}")
    if args.size < 64 or args.size % 8:
        raise ValueError(f"--size must be a multiple of 8 from 64 on, got {args.size}")
    if not 0 <= args.noise <= 1:
        raise ValueError(f"--noise must lie between 0 and 1, got {args.noise}")
    if args.draws < 1:
        raise ValueError(f"--draws must be at least 1, got {args.draws}")
    methods: dict[str, Callable[[Pair], Tensor]] = {
        "kfit": partial(register, motion=args.motion),
        "Kornia": by_kornia,
        "ECC": partial(by_ecc, motion=args.motion),
        "ECC, no blur": partial(by_ecc, blur=1, motion=args.motion),
    }
    if find_spec("SimpleITK"):
        methods["SimpleITK"] = by_simpleitk
    else:
        log.info("SimpleITK is not installed, so it is left out; pip install 'kfit[bench]' brings it")
    rows: list[list[str]] = []
    found: dict[str, list[float]] = {name: [] for name in ("before", "floor", *methods)}
    seconds: dict[str, list[float]] = {name: [] for name in methods}
    with progress() as bar:
        task = bar.add_task("registering", total=len(args.pictures) * args.draws * len(methods))
        for name in args.pictures:
            for seed in range(args.seed, args.seed + args.draws):
                pair = make_pair(name, args.size, args.noise, seed, args.motion)
                found["before"].append(corner_distance(pair.truth.new_ones(3).diag(), pair))
                found["floor"].append(noise_floor(pair, args.noise, args.motion))
                for method, estimate in methods.items():
                    begun = time.perf_counter()
                    found[method].append(corner_distance(estimate(pair), pair))
                    seconds[method].append(time.perf_counter() - begun)
                    bar.update(task, advance=1, description=f"registering {name}")
            rows.append(row(name, found, seconds, args.draws))
    rows.append(row("median of all", found, seconds, len(found["kfit"])))
    section = Section(
        f"{args.motion.capitalize()} maps: mean corner distance in pixels (seconds)",
        ["picture", "before", "floor", *methods],
        rows,
        [compared(found["kfit"], found[rival], found["floor"], rival, args.draws) for rival in list(methods)[1:]],
    )
    show([section], 110)
    if args.out:
        write_page(args.out, "Registration", command("registration", args, parser().get_defaults()), [section])


def row(name: str, found: dict[str, list[float]], seconds: dict[str, list[float]], last: int) -> list[str]:
    """Medians of the last pairs."""
    middle = {k: statistics.median(numbers[-last:]) for k, numbers in found.items()}
    cells = [f"{middle[k]:.3f} ({statistics.median(s[-last:]):.2f})" for k, s in seconds.items()]
    return [name, f"{middle['before']:.1f}", f"{middle['floor']:.3f}", *cells]


def compared(ours: list[float], theirs: list[float], floor: list[float], rival: str, draws: int) -> str:
    """On how many pairs kfit comes at least as near as a rival, on how many one beats the other by the floor, and how
    many pairs it loses that the rival finds."""
    nearer = [their - our for our, their in zip(ours, theirs, strict=True)]
    clear = sum(by > least for by, least in zip(nearer, floor, strict=True))
    worse = sum(-by > least for by, least in zip(nearer, floor, strict=True))
    lost = sum(our > LOST >= their for our, their in zip(ours, theirs, strict=True))
    summary = (
        f"kfit is at least as accurate as {rival} on {sum(by >= 0 for by in nearer)} of {len(nearer)} pairs: "
        f"nearer by more than the floor on {clear}, further by more than it on {worse}; it loses {lost} (off by over "
        f"{LOST:g} pixel) that {rival} finds"
    )
    if draws == 1:
        return summary
    starts = range(0, len(ours), draws)
    medians = [(statistics.median(ours[i : i + draws]), statistics.median(theirs[i : i + draws])) for i in starts]
    return f"{summary}; by the median of {draws} draws on {sum(o <= t for o, t in medians)} of {len(medians)} pictures"


def register(pair: Pair, motion: str = "homography") -> Tensor:
    """By `kfit.register` with its default settings."""
    import kfit

    found = kfit.register(pair.template, pair.observed, motion)  # type: ignore[arg-type]
    assert found.matrix is not None  # neither motion bends
    return found.matrix[0].double()


def by_kornia(pair: Pair) -> Tensor:
    """Kornia's ImageRegistrator with its default settings; it has no affine model, so it finds homographies."""
    import torch
    from kornia.geometry import ImageRegistrator
    from kornia.geometry.conversions import denormalize_homography

    size = pair.template.shape[-2:]
    with torch.enable_grad():
        found = ImageRegistrator("homography").register(pair.template[None], pair.observed[None]).detach().double()
    # It gives where a pixel of the observed picture came from.
    matrix: Tensor = torch.linalg.inv(denormalize_homography(found, size, size, align_corners=False)[0])
    return matrix


def by_ecc(pair: Pair, blur: int = 5, motion: str = "homography") -> Tensor:
    """OpenCV's findTransformECC on grey pictures; where it gives up, its answer is that nothing moved."""
    import cv2
    import numpy as np
    import torch

    template, observed = (picture.mean(0).numpy() for picture in (pair.template, pair.observed))
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 500, 1e-7)
    affine = motion == "affine"
    start = np.eye(3, dtype=np.float32)[: 2 if affine else 3]
    model = cv2.MOTION_AFFINE if affine else cv2.MOTION_HOMOGRAPHY
    try:
        _, found = cv2.findTransformECC(template, observed, start, model, criteria, None, blur)
    except cv2.error:
        found = start
    return torch.from_numpy(np.concatenate([found, [[0, 0, 1]]]) if affine else found).double()


def by_simpleitk(pair: Pair) -> Tensor:
    """SimpleITK's registration method, coarse to fine, by correlation: affine, as it has no homographies.

    Settings as in its examples: gradient descent with scales from physical shift, shrunk by 4, 2 and 1.
    """
    import numpy as np
    import SimpleITK as sitk  # type: ignore[import-untyped]  # noqa: N813
    import torch

    moving, fixed = (sitk.GetImageFromArray(x.mean(0).numpy()) for x in (pair.template, pair.observed))
    method = sitk.ImageRegistrationMethod()
    method.SetMetricAsCorrelation()
    method.SetInterpolator(sitk.sitkLinear)
    method.SetOptimizerAsRegularStepGradientDescent(1.0, 1e-4, 300)
    method.SetOptimizerScalesFromPhysicalShift()
    method.SetShrinkFactorsPerLevel([4, 2, 1])
    method.SetSmoothingSigmasPerLevel([2, 1, 0])
    start = sitk.CenteredTransformInitializer(
        fixed, moving, sitk.AffineTransform(2), sitk.CenteredTransformInitializerFilter.GEOMETRY
    )
    method.SetInitialTransform(start, inPlace=True)
    method.Execute(fixed, moving)
    ends = np.array([start.TransformPoint(point) for point in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))])
    # It takes points of the fixed picture to the moving one.
    inverse = np.eye(3)
    inverse[:2] = np.stack([ends[1] - ends[0], ends[2] - ends[0], ends[0]], 1)
    return torch.from_numpy(np.linalg.inv(inverse))
