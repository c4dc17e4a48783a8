"""Register ten pictures with their warped, darkened and noisy twins, by kfit and by its rivals."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from jsonargparse import ArgumentParser, Namespace

if TYPE_CHECKING:
    from torch import Tensor

# Those that come with scikit-image, so that nothing is downloaded.
PICTURES = (
    "astronaut", "brick", "camera", "cat", "coffee", "coins", "immunohistochemistry", "moon", "retina", "rocket",
)  # fmt: skip


@dataclass(frozen=True)
class Pair:
    """A picture, what became of it, and the map of pixels (3, 3) from the one to the other."""

    template: Tensor
    observed: Tensor
    truth: Tensor


def parser() -> ArgumentParser:
    """Arguments of ``kfit bench registration``."""
    parser = ArgumentParser(
        description="Register ten pictures of scikit-image with their twins: warped by a known homography (roll up to "
        "8°, shift up to 6 %, scale up to 8 %, each corner up to another 2 %), brightness · gain + bias, noise. Prints "
        "for each picture the mean distance in pixels between where the corners are taken and where they belong, and "
        "the seconds: kfit (Levenberg–Marquardt, coarse to fine), Kornia's ImageRegistrator and OpenCV's "
        "findTransformECC with their default settings (ECC with up to 500 iterations), and ECC without its blur."
    )
    parser.add_argument("--pictures", type=list[str], default=list(PICTURES), help="names in skimage.data, as [a,b]")
    parser.add_argument("--size", type=int, default=192, help="width of the pictures in pixels")
    parser.add_argument("--noise", type=float, default=0.02, help="standard deviation of the noise, of a range of 1")
    parser.add_argument("--seed", type=int, default=0, help="chooses maps, brightness and noise")
    return parser


def run(said: Namespace) -> None:
    """Register, and print the table."""
    from rich.console import Console
    from rich.progress import Progress
    from rich.table import Table

    unknown = sorted(set(said.pictures) - set(PICTURES))
    if unknown or not said.pictures:
        raise ValueError(f"--pictures: unknown {', '.join(unknown) or 'nothing'}; known are {', '.join(PICTURES)}")
    if said.size < 64 or said.size % 8:
        raise ValueError(f"--size must be a multiple of 8 from 64 on, got {said.size}")
    methods: dict[str, Callable[[Pair], Tensor]] = {
        "kfit": register,
        "Kornia": by_kornia,
        "ECC": by_ecc,
        "ECC, no blur": lambda pair: by_ecc(pair, blur=1),
    }
    table = Table("picture", "before", *methods, title="mean corner distance in pixels (seconds)")
    found: dict[str, list[float]] = {name: [] for name in methods}
    console = Console(stderr=True)
    with Progress(console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task("registering", total=len(said.pictures) * len(methods))
        for name in said.pictures:
            pair = make_pair(name, said.size, said.noise, said.seed)
            cells = [name, f"{corner_distance(pair.truth.new_ones(3).diag(), pair):.1f}"]
            for method, estimate in methods.items():
                begun = time.perf_counter()
                distance = corner_distance(estimate(pair), pair)
                cells.append(f"{distance:.3f} ({time.perf_counter() - begun:.2f})")
                found[method].append(distance)
                bar.update(task, advance=1, description=f"registering {name}")
            table.add_row(*cells)
    Console(width=110, file=sys.stdout).print(table)
    for rival in list(methods)[1:]:
        count = sum(ours <= theirs for ours, theirs in zip(found["kfit"], found[rival], strict=True))
        print(f"kfit is at least as accurate as {rival} on {count} of {len(said.pictures)}")


def make_pair(name: str, size: int, noise: float, seed: int) -> Pair:
    """A picture at ``size`` pixels and its twin, both area means of one drawn twice as large.

    The twin is warped there, by Lanczos, so that no method's own interpolation made it; what the warp brings in from
    outside is the picture's own surroundings. Brightness stays within the range.
    """
    import cv2
    import numpy as np
    import torch
    import torch.nn.functional as F
    from skimage import data

    rng = np.random.default_rng([seed, PICTURES.index(name)])
    picture = np.atleast_3d(getattr(data, name)()).astype(np.float32) / 255
    whole, off = 5 * size // 2, size // 4
    crop = torch.from_numpy(picture).permute(2, 0, 1)[None]
    side = min(crop.shape[-2:])
    top, left = (crop.shape[-2] - side) // 2, (crop.shape[-1] - side) // 2
    crop = crop[..., top : top + side, left : left + side]
    large = F.interpolate(crop, (whole, whole), mode="bicubic", antialias=True, align_corners=False).clamp(0, 1)
    middle, roll = (size - 1) / 2, np.deg2rad(rng.uniform(-8, 8))
    scale, shift = np.exp(rng.uniform(-0.08, 0.08)), rng.uniform(-0.06, 0.06, 2) * size
    turn = scale * np.array([[np.cos(roll), -np.sin(roll)], [np.sin(roll), np.cos(roll)]])
    corners = np.array([[0, 0], [size - 1, 0], [size - 1, size - 1], [0, size - 1]], np.float32)
    moved = (corners - middle) @ turn.T + middle + shift + rng.uniform(-0.02, 0.02, (4, 2)) * size
    truth = cv2.getPerspectiveTransform(corners, moved.astype(np.float32))
    to_large = np.array([[2, 0, off + 0.5], [0, 2, off + 0.5], [0, 0, 1]])
    matrix = to_large @ truth @ np.linalg.inv(to_large)
    pixels = large[0].permute(1, 2, 0).numpy()
    warped = cv2.warpPerspective(pixels, matrix, (whole, whole), flags=cv2.INTER_LANCZOS4).reshape(pixels.shape)
    window = slice(off, off + 2 * size)
    template, twin = (
        F.avg_pool2d(x[..., window, window], 2)[0] for x in (large, torch.from_numpy(warped).permute(2, 0, 1)[None])
    )
    gain = rng.uniform(0.7, 0.9)
    twin = gain * twin + rng.uniform(0.05, 0.95 - gain) + noise * torch.from_numpy(rng.standard_normal(twin.shape))
    return Pair(template, twin.float().clamp(0, 1), torch.from_numpy(truth))


def corner_distance(matrix: Tensor, pair: Pair) -> float:
    """Mean distance in pixels between where two maps of pixels (3, 3) take the corners of the picture."""
    from kornia.geometry.linalg import transform_points

    side = pair.template.shape[-1] - 1
    corners = pair.truth.new_tensor([[[0, 0], [side, 0], [side, side], [0, side]]])
    there, here = (transform_points(m[None].to(corners), corners) for m in (matrix, pair.truth))
    return float((there - here).norm(dim=2).mean())


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
    for level in (3, 2, 1, 0):
        # A little blur, for neither noise nor a bilinear warp is worth fitting; where it reaches past the border, the
        # pixels do not count.
        small = [F.avg_pool2d(picture[None], 2**level) for picture in (pair.template, pair.observed)]
        template, observed = (gaussian_blur2d(picture, (7, 7), (0.8, 0.8)) for picture in small)
        edge = max(1, 4 >> level)
        mask = F.pad(torch.ones_like(observed[0, :1, edge:-edge, edge:-edge]), [edge] * 4)
        motion = "similarity" if level == 3 else "homography"
        generator = Template(template[0], motion, fill=observed[0], mask=mask, light=True)  # type: ignore[arg-type]
        pipeline = FitPipeline(
            generator,
            {"l2": L2()},
            starts,
            LevenbergMarquardt(),
            callbacks=[Pruning({0: 16, 4: 4})],
            num_starts=32 if level == 3 else 1,
            num_steps=12 if level == 3 else 8,
        )
        result = pipeline(Observation(observed, weight=mask[None]), seed=0)
        moving = {k: v for k, v in result.values.items() if k not in ("gain", "bias")}
        matrix = generator.matrix(**moving)
        starts = [Previous(result, on=["gain", "bias"])]
        starts.append(Constant({"corners": generator.corners(matrix)[0].tolist()}))
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
