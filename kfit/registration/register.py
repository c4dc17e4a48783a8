"""Registration of pictures and volumes in one call: coarse to fine, from several starts."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from kfit.callbacks import Pruning
from kfit.core import Energy, FitResult, Observation, Optimizer, Prior, ResidualEnergy, Schedule
from kfit.core.arguments import check_arguments
from kfit.core.check import check_choice, check_shape
from kfit.energies import L2, BendingEnergy
from kfit.fitting.pipeline import FitPipeline
from kfit.generators import Template, VolumeTemplate
from kfit.generators.motions import BENDING, Motion, pixel_grid
from kfit.generators.volume_motions import VOLUME_MOTIONS
from kfit.optimizers import LBFGS, LevenbergMarquardt
from kfit.registration.pair import Pair, checked_pair, pyramid_levels
from kfit.registration.result import Registration
from kfit.registration.stages import Stage, first_stage, motions_of, next_stage
from kfit.registration.starts import FixedStarts


def register(
    moving: Tensor,
    fixed: Tensor,
    motion: Motion = "homography",
    *,
    energy: Energy | None = None,
    moving_mask: Tensor | None = None,
    fixed_mask: Tensor | None = None,
    light: bool = True,
    control: tuple[int, int] = (5, 5),
    smoothness: float = 0.1,
    min_overlap: float = 0.25,
    initial: Tensor | None = None,
    seed: int = 0,
) -> Registration:
    """Find the motion that maps moving pictures or volumes to fixed ones.

    Fits a `kfit.generators.Template`, or for volumes a `kfit.generators.VolumeTemplate`, from coarse to fine. At the
    coarsest level, the likeliest of 64 starts are fitted: identity, phase correlation, for pictures matched SIFT
    features, and random motions up to 30°, 0.3 half-widths and 15 %. Motions of more freedom start at the answers of
    simpler ones. Energies that are sums of squares are minimised by Levenberg–Marquardt, others by L-BFGS. Only the
    overlap is compared.

    Args:
        moving, fixed: (B, C, H, W) in [0, 1], B pairs, or (C, H, W), or volumes (B, C, D, H, W) of cubic voxels; the
            two may differ in depth, height and width.
        motion: "translation", "euclidean", "similarity", "affine", "homography", "tps" (thin-plate spline) or "flow";
            for volumes one of the first four.
        energy: compares warped and fixed pictures; mean squares by default. `kfit.energies.NCC` and
            `kfit.energies.MutualInformation` serve pictures of other lighting or other sensors.
        moving_mask, fixed_mask: (B, 1, H, W) or (B, 1, D, H, W) in [0, 1]; 0 excludes a pixel.
        light: whether to fit a gain and an offset of the moving picture's brightness too.
        control: (rows, columns) of the control points of tps and flow; at coarse levels at most one for each pixel.
        smoothness: weight of the bending energy of a flow, in half-widths squared.
        min_overlap: least fraction of the fixed picture's weight that the moving one must cover.
        initial: (B, 3, 3), for volumes (B, 4, 4), maps of pixels from moving to fixed near which to start, instead of
            the 64 starts.
        seed: determines the random motions.

    Raises:
        TypeError, ValueError: naming the wrong argument.

    Example:
        >>> import torch, kfit
        >>> moving = torch.rand(1, 1, 6, 6, generator=torch.Generator().manual_seed(0))
        >>> moving = torch.nn.functional.interpolate(moving, (48, 48), mode="bicubic").clamp(0, 1)
        >>> found = kfit.register(moving, moving.roll(3, -1), "translation")
        >>> [round(shift) for shift in found.matrix[0, :2, 2].tolist()]
        [3, 0]

        Volumes:

        >>> moving = torch.rand(1, 1, 4, 4, 4, generator=torch.Generator().manual_seed(0))
        >>> moving = torch.nn.functional.interpolate(moving, (16, 16, 16), mode="trilinear")
        >>> found = kfit.register(moving, moving.roll((2, -1), (2, 4)), "translation")
        >>> [round(shift) for shift in found.matrix[0, :3, 3].tolist()]  # x, y, z
        [-1, 0, 2]
    """
    pair = checked_pair(moving, fixed, moving_mask, fixed_mask)
    check_arguments(register, locals(), control=(2,), smoothness=(0,), min_overlap=(0, 1), seed=(0,))
    volumes = len(pair.size) == 3
    if volumes:
        check_choice("motion of volumes", motion, VOLUME_MOTIONS)
    if energy is not None and not isinstance(energy, Energy):
        raise TypeError(f"energy must be a kfit.core.Energy, got {type(energy).__name__}")
    if volumes and energy is not None and not energy.volumes:
        raise ValueError(f"energy must compare volumes, which {type(energy).__name__} does not; kfit.energies.L2 does")
    if initial is not None:
        check_shape("initial", initial, (len(pair.moving), *[len(pair.size) + 1] * 2))
    settings = _Settings(energy or L2(), light, control, smoothness, min_overlap)
    levels = pyramid_levels(pair.size)
    motions = motions_of(motion, len(levels))
    state: Stage | None = None
    fits: list[FitResult] = []
    for number, (shrink, kind) in enumerate(zip(levels, motions, strict=True)):
        last = number == len(levels) - 1
        level = pair.at(shrink, blur=0.5 if last and len(levels) > 1 else 0.8)
        template = settings.template(level, kind)
        if state is None:
            state = first_stage(pair, template, kind, initial, seed)
        else:
            state = next_stage(state, template, kind, pair)
        result = _fit(template, level, settings, state, freeze_overlap=last, seed=seed)
        state = Stage(kind, template, result, state.candidates)
        fits.append(result)
    return _answer(pair, motion, tuple(fits), settings)


@dataclass(frozen=True)
class _Settings:
    energy: Energy
    light: bool
    control: tuple[int, int]
    smoothness: float
    min_overlap: float

    def template(self, level: Pair, kind: Motion) -> Template | VolumeTemplate:
        """Return the template of a level; below 256 pixels a side it samples a finer grid."""
        if len(level.size) == 3:
            return VolumeTemplate(level.moving, kind, mask=level.moving_mask, light=self.light)  # type: ignore[arg-type]
        control = (min(self.control[0], level.size[0]), min(self.control[1], level.size[1]))
        oversampling = 4 if max(level.size) <= 256 else 2 if max(level.size) <= 1024 else 1
        return Template(
            level.moving, kind, mask=level.moving_mask, light=self.light, oversampling=oversampling, control=control
        )

    def optimizer(self) -> Optimizer:
        return LevenbergMarquardt() if isinstance(self.energy, ResidualEnergy) else LBFGS()


def _fit(
    template: Template | VolumeTemplate, level: Pair, settings: _Settings, state: Stage, freeze_overlap: bool, seed: int
) -> FitResult:
    terms: dict[str, Energy | Prior] = {"energy": settings.energy}
    weights: dict[str, float | Schedule] = {}
    if isinstance(template, Template) and template.motion == "flow" and min(template.control) >= 3:
        terms["bending"], weights["bending"] = BendingEnergy("displacement"), settings.smoothness
    weight = level.fixed_mask
    if freeze_overlap and state.num_candidates == 1:
        weight = weight * _covered(template, state)
    many, squares = state.num_starts > 2, isinstance(settings.energy, ResidualEnergy)
    pipeline = FitPipeline(
        template,
        terms,
        list(state.starts),
        settings.optimizer(),
        weights=weights,
        callbacks=[Pruning({0: 16, 4: 4})] if many else [],
        num_starts=state.num_starts,
        num_candidates=state.num_candidates,
        num_steps=(12 if many else 8) if squares else (30 if many else 20),
        min_overlap=settings.min_overlap,
        history=False,
    )
    result: FitResult = pipeline(Observation(level.fixed, weight=weight), seed=seed)
    return result


def _covered(template: Template | VolumeTemplate, state: Stage) -> Tensor:
    """Return 1 where the start covers a pixel completely: a variable overlap would shrink to reduce noise."""
    first = state.starts[0]
    assert isinstance(first, FixedStarts)
    pixels = template.pixels if isinstance(template, Template) else template.voxels
    values = {name: value[:, 0] for name, value in first.values.items()}
    with torch.no_grad():
        if "gain" in template.variables:
            ones = torch.ones(len(next(iter(values.values())))).to(pixels)
            values |= {"gain": ones, "bias": 0 * ones}
        if len(pixels) > 1:
            values["template"] = torch.arange(len(pixels), device=pixels.device)
        covered: Tensor = template(**values).field("weight")
    return (covered > 0.999).to(covered)


def _answer(pair: Pair, motion: Motion, fits: tuple[FitResult, ...], settings: _Settings) -> Registration:
    """Draw the full pictures with the values of the last level, without blur."""
    values = fits[-1].values
    whole = settings.template(pair, motion)
    moving = {name: values[name] for name in whole.moving}
    template = {"template": torch.arange(len(pair.moving), device=pair.moving.device)} if len(pair.moving) > 1 else {}
    with torch.no_grad():
        drawn = whole(**values, **template)
        places = whole.places(**moving)
        matrix = None if motion in BENDING else whole.matrix(**moving)
    assert drawn.weight is not None  # a template always has one
    ones = torch.ones(len(pair.moving)).to(pair.fixed)
    both, all_of = drawn.weight * pair.fixed_mask, pair.fixed_mask
    return Registration(
        matrix=None if matrix is None else matrix / matrix[:, -1:, -1:],
        displacement=(places - pixel_grid(places, pair.size)).movedim(-1, 1),
        warped=drawn.image,
        weight=drawn.weight,
        overlap=both.flatten(1).sum(1) / all_of.flatten(1).sum(1).clamp_min(1e-6),
        energy=fits[-1].energy,
        gain=values.get("gain", ones),
        offset=values.get("bias", 0 * ones),
        fits=fits,
    )
