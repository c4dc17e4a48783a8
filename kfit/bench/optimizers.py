"""Compare all optimizers on registration, pose and code inversion: energy reached, pictures drawn, successes."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from jsonargparse import ArgumentParser, Namespace

from kfit.runtime.console import progress, table_console

if TYPE_CHECKING:
    from torch import Tensor

    from kfit.core import Energy, FitResult, Generator, Initializer, Observation, Optimizer, Prior


@dataclass(frozen=True)
class Problem:
    """Problems of one kind, and how to decide which of them a fit has solved.

    Attributes:
        rates, sigma: for Adam and CMA-ES, in raw units.
        solved: which problems (B,) a result solves.
    """

    name: str
    generator: Generator
    energies: dict[str, Energy | Prior]
    weights: dict[str, float]
    initializers: list[Initializer]
    observation: Observation
    rates: float | dict[str, float]
    sigma: float | dict[str, float]
    solved: Callable[[FitResult], Tensor]


def parser() -> ArgumentParser:
    """Arguments of ``kfit bench optimizers``."""
    parser = ArgumentParser(
        description="Fit three kinds of problems by every optimizer, each allowed to draw about the same number of "
        "pictures a start, and print the median energy reached, pictures drawn a problem, seconds a problem and the "
        "share solved. Registration: an astronaut and a cup of coffee at 64 pixels, against affine warps of "
        "themselves; solved when the corners lie within 1 pixel on average. Pose: a bundled model against views of "
        "objects that it has never seen, code, pose, shift and scale free; solved within 10° (symmetry counted). "
        "Inversion: the code of a picture that the model drew itself, at the true pose; solved when the pictures "
        "differ by at most 0.01 (root mean square).",
        epilog="example:\n  kfit bench optimizers --category mug --problems 2",
    )
    parser.add_argument("--category", type=str, default="laptop", help="the bundled model for pose and inversion")
    parser.add_argument("--problems", type=int, default=4, help="problems of each kind")
    parser.add_argument("--starts", type=int, default=3, help="starts a problem")
    parser.add_argument("--budget", type=int, default=100, help="pictures to draw for each start, about")
    parser.add_argument("--seed", type=int, default=0, help="chooses problems and starts")
    return parser


def run(args: Namespace) -> None:
    """Fit everything, and print the table."""
    from rich.table import Table

    from kfit import FitPipeline

    for name in ("problems", "starts", "budget"):
        if args[name] < 1:
            raise ValueError(f"--{name} must be at least 1, got {args[name]}")
    table = Table("problem", "optimizer", "energy", "pictures", "seconds", "solved")
    with progress() as bar:
        task = bar.add_task("building problems")
        problems = [
            *(registration(name, args.problems, args.seed) for name in ("astronaut", "coffee")),
            pose(args.category, args.problems, args.seed),
            inversion(args.category, args.problems, args.seed),
        ]
        bar.update(task, total=len(problems) * len(optimizers(problems[0], args.budget)))
        for problem in problems:
            for name, (optimizer, steps) in optimizers(problem, args.budget).items():
                bar.update(task, description=f"{problem.name}: {name}")
                pipeline = FitPipeline(
                    problem.generator,
                    problem.energies,
                    problem.initializers,
                    optimizer,
                    weights=dict(problem.weights),
                    num_starts=args.starts,
                    num_steps=steps,
                )
                begun = time.perf_counter()
                result = pipeline(problem.observation, seed=args.seed)
                spent = (time.perf_counter() - begun) / args.problems
                table.add_row(
                    problem.name,
                    name,
                    f"{float(result.energy.nanmedian()):.2e}",
                    f"{result.num_evaluations / args.problems:.0f}",
                    f"{spent:.2f}",
                    f"{100 * float(problem.solved(result).float().mean()):.0f} %",
                )
                bar.advance(task)
            table.add_section()
    table_console(110).print(table)


def optimizers(problem: Problem, budget: int) -> dict[str, tuple[Optimizer, int]]:
    """Every optimizer and its number of steps, by what a step draws for each start."""
    import math

    from kfit.optimizers import CMAES, LBFGS, Adam, AutoAdam, LevenbergMarquardt, Stages

    variables = problem.generator.variables
    dim = sum(math.prod(variable.shape) for variable in variables.values())
    squares, population = dim + 3, 4 + math.floor(3 * math.log(dim))
    finish = max(1, budget // 2 // squares)
    adam = Adam(problem.rates)
    return {
        "Adam": (adam, budget),
        "AutoAdam": (AutoAdam(), max(1, budget - len(variables))),
        "LBFGS": (LBFGS(), max(1, budget // 2)),
        "LevenbergMarquardt": (LevenbergMarquardt(), max(1, budget // squares)),
        "CMAES": (CMAES(problem.sigma), max(1, budget // (population + 1))),
        "Stages: Adam, then LM": (
            Stages([(adam, max(1, budget // 2)), (LevenbergMarquardt(), finish)]),
            max(1, budget // 2) + finish,
        ),
    }


def registration(name: str, count: int, seed: int) -> Problem:
    """A picture of scikit-image and ``count`` affine warps of it."""
    import torch
    import torch.nn.functional as F
    from kornia.geometry.linalg import transform_points
    from skimage import data

    from kfit.core import Observation
    from kfit.energies import L2
    from kfit.generators import Template
    from kfit.initializers import Constant, Uniform

    picture = torch.from_numpy(getattr(data, name)()).permute(2, 0, 1)[None].float() / 255
    side = min(picture.shape[-2:])
    picture = F.interpolate(picture[..., :side, :side], (64, 64), mode="area")[0]
    generator, rng = Template(picture, "affine"), torch.Generator().manual_seed(seed)

    def even(low: float, high: float, *shape: int) -> Tensor:
        return low + (high - low) * torch.rand(count, *shape, generator=rng)

    truth = {
        "roll": even(-0.3, 0.3),
        "shift": even(-0.15, 0.15, 2),
        "scale": even(0.85, 1.15),
        "stretch": even(0.95, 1.05),
        "shear": even(-0.05, 0.05),
    }
    corners = torch.tensor([[0.0, 0.0], [63.0, 0.0], [63.0, 63.0], [0.0, 63.0]]).expand(count, 4, 2)

    def solved(result: FitResult) -> Tensor:
        there, here = (transform_points(generator.matrix(**values), corners) for values in (result.values, truth))
        near: Tensor = (there - here).norm(dim=2).mean(1) < 1
        return near

    starts: list[Initializer] = [
        Uniform("roll", -0.2, 0.2),
        Uniform("shift", -0.1, 0.1),
        Constant({"scale": 1.0, "stretch": 1.0, "shear": 0.0}),
    ]
    observation = Observation(generator(**truth).image, keys=tuple(range(count)))
    return Problem(f"registration, {name}", generator, {"l2": L2()}, {}, starts, observation, 0.01, 0.05, solved)


def pose(category: str, count: int, seed: int) -> Problem:
    """Views of unseen objects, by an energy that is a sum of squares throughout."""
    from kfit.bench.held_out_views import held_out_views
    from kfit.energies import CodePrior, Perceptual, Silhouette
    from kfit.features import EfficientNetLite0
    from kfit.generators import SimilarityWarp, fixed_camera
    from kfit.geometry import rotation_error, rotation_from_angles
    from kfit.initializers import Constant, EncoderPosterior, SphereGrid
    from kfit.models import load
    from kfit.pose.defaults import RATES

    model = load(category)
    views = held_out_views(model, count, seed)

    def solved(result: FitResult) -> Tensor:
        angles = (result.values[name].double() for name in ("azimuth", "elevation", "roll"))
        error = rotation_error(rotation_from_angles(*angles), views.rotation, model.card.known.symmetry)
        return error.rad2deg() < 10

    return Problem(
        f"pose, {category}",
        SimilarityWarp(fixed_camera(model.generator)),
        {"perceptual": Perceptual(EfficientNetLite0()), "silhouette": Silhouette(), "prior": CodePrior()},
        {"silhouette": 5.0, "prior": 0.02},
        [
            SphereGrid(elevation_deg=(0.0, 60.0)),
            EncoderPosterior(model.encoder),
            Constant({"roll": 0.0, "shift": 0.0, "scale": 1.0}),
        ],
        views.observation,
        RATES,
        {**dict.fromkeys(RATES, 0.05), "code": 0.3},
        solved,
    )


def inversion(category: str, count: int, seed: int) -> Problem:
    """Codes of pictures that the model drew itself, at the pose in which it drew them."""
    import torch

    from kfit.core import Observation
    from kfit.energies import L2
    from kfit.generators import fixed_camera
    from kfit.initializers import Uniform
    from kfit.models import load

    field = fixed_camera(load(category).generator)
    generator = field.bind(azimuth=torch.tensor(0.6), elevation=torch.tensor(0.4))
    code = torch.randn(count, *generator.variables["code"].shape, generator=torch.Generator().manual_seed(seed))
    with torch.no_grad():
        drawn = generator(code=code)
    observation = Observation(drawn.image, drawn.mask, keys=tuple(range(count)))
    return Problem(
        f"inversion, {category}",
        generator,
        {"l2": L2()},
        {},
        [Uniform("code", -0.5, 0.5)],
        observation,
        0.1,
        0.3,
        lambda result: result.energy.sqrt() <= 0.01,
    )
