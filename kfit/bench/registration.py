"""Register ten pictures with their warped, darkened and noisy twins, by kfit and by its rivals."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from jsonargparse import ArgumentParser, Namespace

from kfit.bench.registration_pairs import PICTURES, Pair, corner_distance, inside, make_pair, noise_floor
from kfit.runtime.console import progress, table_console

if TYPE_CHECKING:
    from torch import Tensor


def parser() -> ArgumentParser:
    """Arguments of ``kfit bench registration``."""
    parser = ArgumentParser(
        description="Register ten pictures of scikit-image with their twins: warped by a known homography (roll up to "
        "8°, shift up to 6 %, scale up to 8 %, each corner up to another 2 %), brightness · gain + bias, noise. Prints "
        "for each picture the mean distance in pixels between where the corners are taken and where they belong, and "
        "the seconds: kfit (Levenberg–Marquardt, coarse to fine), Kornia's ImageRegistrator and OpenCV's "
        "findTransformECC with their default settings (ECC with up to 500 iterations), and ECC without its blur. The "
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
    parser.add_argument("--size", type=int, default=192, help="width of the pictures in pixels, a multiple of 8")
    parser.add_argument("--noise", type=float, default=0.02, help="standard deviation of the noise, of a range of 1")
    parser.add_argument("--draws", type=int, default=1, help="pairs of each picture; the table shows their medians")
    parser.add_argument("--seed", type=int, default=0, help="chooses maps, brightness and noise")
    return parser


def run(args: Namespace) -> None:
    """Register, and print the table."""
    from rich.table import Table

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
        "kfit": register,
        "Kornia": by_kornia,
        "ECC": by_ecc,
        "ECC, no blur": lambda pair: by_ecc(pair, blur=1),
    }
    table = Table("picture", "before", "floor", *methods, title="mean corner distance in pixels (seconds)")
    found: dict[str, list[float]] = {name: [] for name in ("before", "floor", *methods)}
    seconds: dict[str, list[float]] = {name: [] for name in methods}
    with progress() as bar:
        task = bar.add_task("registering", total=len(args.pictures) * args.draws * len(methods))
        for name in args.pictures:
            for seed in range(args.seed, args.seed + args.draws):
                pair = make_pair(name, args.size, args.noise, seed)
                found["before"].append(corner_distance(pair.truth.new_ones(3).diag(), pair))
                found["floor"].append(noise_floor(pair, args.noise))
                for method, estimate in methods.items():
                    begun = time.perf_counter()
                    found[method].append(corner_distance(estimate(pair), pair))
                    seconds[method].append(time.perf_counter() - begun)
                    bar.update(task, advance=1, description=f"registering {name}")
            middle = {k: statistics.median(numbers[-args.draws :]) for k, numbers in found.items()}
            cells = [f"{middle[k]:.3f} ({statistics.median(s[-args.draws :]):.2f})" for k, s in seconds.items()]
            table.add_row(name, f"{middle['before']:.1f}", f"{middle['floor']:.3f}", *cells)
    table_console(110).print(table)
    for rival in list(methods)[1:]:
        print(compared(found["kfit"], found[rival], found["floor"], rival, args.draws))


def compared(ours: list[float], theirs: list[float], floor: list[float], rival: str, draws: int) -> str:
    """On how many pairs kfit comes at least as near as a rival, and on how many one beats the other by the floor."""
    nearer = [their - our for our, their in zip(ours, theirs, strict=True)]
    clear = sum(by > least for by, least in zip(nearer, floor, strict=True))
    worse = sum(-by > least for by, least in zip(nearer, floor, strict=True))
    told = (
        f"kfit is at least as accurate as {rival} on {sum(by >= 0 for by in nearer)} of {len(nearer)} pairs: "
        f"nearer by more than the floor on {clear}, further by more than it on {worse}"
    )
    if draws == 1:
        return told
    starts = range(0, len(ours), draws)
    medians = [(statistics.median(ours[i : i + draws]), statistics.median(theirs[i : i + draws])) for i in starts]
    return f"{told}; by the median of {draws} draws on {sum(o <= t for o, t in medians)} of {len(medians)} pictures"


def register(pair: Pair) -> Tensor:
    """By a fit: a similarity from many starts at an eighth of the size, then homographies up to the whole."""
    import torch
    import torch.nn.functional as F
    from kornia.filters import gaussian_blur2d

    from kfit import FitPipeline
    from kfit.callbacks import Pruning
    from kfit.core import Initializer, Observation
    from kfit.energies import L2
    from kfit.generators import Template
    from kfit.initializers import Constant, Previous, Uniform
    from kfit.optimizers import LevenbergMarquardt

    starts: list[Initializer] = [
        Uniform("roll", -0.25, 0.25),
        Uniform("shift", -0.2, 0.2),
        Constant({"scale": 1.0, "gain": 1.0, "bias": 0.0}),
    ]
    corners = pair.template.new_zeros(1, 4, 2)
    for level in (3, 2, 1, 0):
        # Blurred, for what is finer than pixels came down into both pictures differently; at last only a little, for
        # blur costs accuracy. It spoils the outermost pixels, which do not count; those beside them hold the corners.
        blur = 0.8 if level else 0.5
        small = [F.avg_pool2d(picture[None], 2**level) for picture in (pair.template, pair.observed)]
        template, observed = (gaussian_blur2d(picture, (7, 7), (blur, blur)) for picture in small)
        mask = F.pad(torch.ones_like(observed[0, :1, 1:-1, 1:-1]), [1] * 4)
        motion = "similarity" if level == 3 else "homography"
        generator = Template(template[0], motion, mask=mask, light=True, oversampling=4)  # type: ignore[arg-type]
        # An overlap that may still change shrinks, for the less of it the less noise; so at last it stays as found.
        weight = mask[None] if level else mask[None] * inside(generator, corners)
        pipeline = FitPipeline(
            generator,
            {"l2": L2()},
            starts,
            LevenbergMarquardt(),
            callbacks=[Pruning({0: 16, 4: 4})],
            num_starts=32 if level == 3 else 1,
            num_steps=12 if level == 3 else 8,
        )
        result = pipeline(Observation(observed, weight=weight), seed=0)
        moving = {k: v for k, v in result.values.items() if k not in ("gain", "bias")}
        matrix = generator.matrix(**moving)
        corners = generator.corners(matrix)
        starts = [Previous(result, on=["gain", "bias"]), Constant({"corners": corners[0].tolist()})]
    return matrix[0].double()


def by_kornia(pair: Pair) -> Tensor:
    """Kornia's ImageRegistrator with its default settings."""
    import torch
    from kornia.geometry import ImageRegistrator
    from kornia.geometry.conversions import denormalize_homography

    size = pair.template.shape[-2:]
    with torch.enable_grad():
        found = ImageRegistrator("homography").register(pair.template[None], pair.observed[None]).detach().double()
    # It tells where a pixel of the observed picture came from.
    matrix: Tensor = torch.linalg.inv(denormalize_homography(found, size, size, align_corners=False)[0])
    return matrix


def by_ecc(pair: Pair, blur: int = 5) -> Tensor:
    """OpenCV's findTransformECC on grey pictures; where it gives up, its answer is that nothing moved."""
    import cv2
    import numpy as np
    import torch

    template, observed = (picture.mean(0).numpy() for picture in (pair.template, pair.observed))
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 500, 1e-7)
    start = np.eye(3, dtype=np.float32)
    try:
        _, found = cv2.findTransformECC(template, observed, start, cv2.MOTION_HOMOGRAPHY, criteria, None, blur)
    except cv2.error:
        found = np.eye(3)
    return torch.from_numpy(found).double()
