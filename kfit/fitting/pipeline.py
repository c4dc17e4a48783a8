"""The pipeline: start, render, compare, step, select, for B problems × S starts at once."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace
from itertools import chain
from typing import Any

import torch
from torch import Tensor, nn

from kfit.core import (
    Callback,
    Energy,
    Evaluation,
    FitResult,
    FitState,
    Generator,
    Initializer,
    Observation,
    Optimizer,
    Prior,
    Schedule,
    Selector,
    Variables,
    frozen,
)
from kfit.core.check import check_count, check_range
from kfit.core.rows import broadcast_rows, finite
from kfit.core.seeds import mixed_seed
from kfit.features import FeatureNetwork
from kfit.fitting.check_parts import check_memory, check_observation, check_parts, check_state, check_weights
from kfit.fitting.objective import Objective
from kfit.fitting.recipe import recipe_text
from kfit.fitting.recorder import Recorder
from kfit.fitting.starts import initialize, likeliest
from kfit.runtime.devices import compile_networks, safe_after_fork
from kfit.selectors import LowestEnergy

_log = logging.getLogger(__name__)


class FitPipeline(nn.Module):
    """Fit a generator's variables such that its drawings explain observed pictures.

    The energy of a row is E(x) = Σ_k w_k · e_k(render(x), observation) + Σ_p w_p · p(x). Rows do not interact. The
    pipeline uses frozen copies of the networks; the originals are not changed.

    Args:
        generator: draws.
        energies: energies and priors by name.
        initializers: together they set each of the generator's variables once.
        optimizer: moves the rows.
        weights: weight of each term, a number or a schedule; 1 for terms not named.
        rank_weights: weights by which best-so-far and winner are ranked; by default the final ``weights``. If set,
            terms not named have weight 0.
        selector: selects the winner among a problem's starts.
        callbacks: progress, pruning, recording.
        num_starts: S, number of starts a problem.
        num_candidates: C ≥ S, number of initial values a problem; each is drawn once, without a gradient, and the S of
            least ranking energy become starts. S by default.
        num_steps: steps of the optimizer; the last iterate is evaluated too.
        history: whether the history holds the starts' values at every step, at every so many steps, or not at all;
            energies and terms, which are small, are always recorded.
        min_overlap: if renderings have a weight, as `kfit.generators.Template`'s do, energies are means over the
            overlap, and this is the least fraction of the observation's weight that a row must cover to win. Below it
            the ranking energy is infinite, and a penalty leads the row back.

    Raises:
        ValueError: if weights or rates have unknown names, a variable is set by no initializer or by several, a prior
            is on an unknown variable, or all rank weights are 0.

    Example:
        >>> import torch, kfit
        >>> from kfit.energies import L2
        >>> from kfit.generators import Template
        >>> from kfit.initializers import Uniform
        >>> from kfit.optimizers import Adam
        >>> blob = torch.hann_window(32).outer(torch.hann_window(32))[None]  # a template, (1, 32, 32)
        >>> start = Uniform("shift", -0.3, 0.3)
        >>> fit = kfit.FitPipeline(Template(blob, "translation"), {"l2": L2()}, [start], Adam(0.02), num_starts=8)
        >>> result = fit(kfit.Observation(blob.roll(4, 2)[None]), seed=0)  # moved by 4 of 32 pixels
        >>> result.values["shift"][0, 0].round(decimals=2)  # in half-widths
        tensor(0.2500)
    """

    def __init__(
        self,
        generator: Generator,
        energies: dict[str, Energy | Prior],
        initializers: list[Initializer],
        optimizer: Optimizer,
        weights: dict[str, float | Schedule] | None = None,
        rank_weights: dict[str, float] | None = None,
        selector: Selector | None = None,
        callbacks: Sequence[Callback] = (),
        num_starts: int = 32,
        num_steps: int = 50,
        num_candidates: int | None = None,
        history: bool | int = True,
        min_overlap: float = 0.25,
    ) -> None:
        super().__init__()
        check_count("num_starts", num_starts)
        check_count("num_steps", num_steps, 0)
        if num_candidates is not None:
            check_count("num_candidates", num_candidates)
            if num_candidates < num_starts:
                raise ValueError(f"num_candidates must be at least num_starts, {num_starts}, got {num_candidates}")
        if not isinstance(history, bool):
            check_count("history", history)
        check_range("min_overlap", min_overlap, 0, 1)
        check_parts(generator, energies, initializers, optimizer, selector, callbacks)
        check_weights(energies, weights, rank_weights)
        self.generator = frozen(generator)
        self.energies = frozen(nn.ModuleDict(energies))
        self.initializers = list(initializers)
        self.optimizer = optimizer
        self.weights: dict[str, float | Schedule] = {**dict.fromkeys(energies, 1.0), **(weights or {})}
        self.rank_weights = rank_weights
        self.selector = selector or LowestEnergy()
        self.callbacks = list(callbacks)
        self.num_starts, self.num_steps, self.min_overlap = num_starts, num_steps, min_overlap
        self.history = history
        self.num_candidates = num_starts if num_candidates is None else num_candidates
        if not any((rank_weights or self.weights_at(num_steps)).values()):
            raise ValueError("rank_weights must hold a number other than 0, or no start is better than another")
        # Initializers and optimizers are not modules: their networks are registered here, so that `to` moves them too.
        held = [value for initializer in self.initializers for value in vars(initializer).values()]
        networks = [value for value in held if isinstance(value, nn.Module)]
        self.networks = nn.ModuleList([*networks, *optimizer.networks])
        self.eval()
        zeros = {name: torch.zeros(2, *v.raw_shape) for name, v in generator.variables.items()}
        check_memory(optimizer, optimizer.init(zeros, torch.zeros(2, dtype=torch.long)), 2)

    def train(self, mode: bool = True) -> FitPipeline:
        """Stay in evaluation mode, also inside of a module in training, because the networks are frozen."""
        return super().train(False)

    def to_yaml(self) -> str:
        """Return the recipe that ``kfit pose --fit`` and `kfit.pose.fit_recipe.fit_of` read, without the generator.

        A fit that is read from it gives the same numbers, bit by bit. Only what differs from the defaults is written.

        Raises:
            ValueError: naming a part that text cannot hold, such as one built from a network, or of a class that
                cannot be imported.
        """
        return recipe_text(self)

    def compile(self, **kwargs: Any) -> None:  # type: ignore[override]
        """Compile the generator and the energies' feature networks (`torch.compile`) at their first use.

        Compilation takes up to a minute for each number of rows, and PyTorch caches it on disk. It is meant for long
        runs on a GPU; on a CPU it did not save time. Without a C++ compiler fits run uncompiled.

        Args:
            kwargs: as `torch.compile` takes them; modes with CUDA graphs fail, because one network draws for another.
        """
        networks = (module for module in self.energies.modules() if isinstance(module, FeatureNetwork))
        compile_networks(self.generator, *networks, **kwargs)

    @property
    def device(self) -> torch.device:
        """Device of its networks."""
        return next(chain(self.parameters(), self.buffers(), [torch.empty(0)])).device

    def weights_at(self, step: int) -> dict[str, float]:
        """Return the weights of the terms at a step, 0 to ``num_steps``."""
        return {k: w(step, self.num_steps) if isinstance(w, Schedule) else w for k, w in self.weights.items()}

    @safe_after_fork()
    def forward(self, observation: Observation, *, seed: int | None = None) -> FitResult:
        """Fit B problems.

        Args:
            observation: the pictures to explain.
            seed: with the problems' keys it determines every random number, at least 0; drawn from torch's generator
                by default.

        Raises:
            ValueError: if the observation has no pictures, or lacks a field that an energy compares.
            FitError: if every start of every problem became NaN or infinite.
        """
        check_observation(observation)
        if seed is not None:
            check_count("seed", seed, 0)
        # `trainer.predict` enables inference mode, in which gradients are not available.
        with torch.inference_mode(False), torch.no_grad():
            return self._fit(observation.map(lambda tensor: tensor.clone() if tensor.is_inference() else tensor), seed)

    def _fit(self, observation: Observation, seed: int | None) -> FitResult:
        if observation.num_problems == 0:
            raise ValueError("observation must hold at least one picture, got none")
        seed = int(torch.randint(2**31, ())) if seed is None else seed
        device, count = observation.image.device, observation.num_problems
        problem = torch.arange(count, device=device).repeat_interleave(self.num_starts)
        start = torch.arange(self.num_starts, device=device).repeat(count)
        terms: dict[str, Energy | Prior] = dict(self.energies.items())  # type: ignore[arg-type]
        rank_weights = self.rank_weights or self.weights_at(self.num_steps)
        objective = Objective(self.generator, terms, rank_weights, observation, self.min_overlap)
        with torch.autocast(device.type, enabled=False):  # autocast would round the starts
            proposed = initialize(
                self.initializers, self.generator.variables, observation.first_views(), self.num_candidates, seed
            )
        objective.weights = self.weights_at(0)
        raw = likeliest(objective, proposed, self.num_candidates, self.num_starts)
        nothing = raw[next(iter(raw))].new_full((len(problem),), torch.inf)
        memory = self.optimizer.init(raw, self._seeds(observation, seed))
        state = FitState(0, self.num_steps, problem, start, raw, {}, nothing, {}, nothing, {}, memory)
        for callback in self.callbacks:
            callback.on_start(state)
        recorder = Recorder(count, self.num_starts, int(self.history))
        for step in range(self.num_steps + 1):
            objective.weights = self.weights_at(step)
            if step < self.num_steps:
                new, seen, memory = self.optimizer.step(objective, state.raw, state.problem, state.optimizer)
                check_memory(self.optimizer, memory, len(state.problem))
            else:  # the last iterate is only evaluated
                new, seen, memory = state.raw, objective(state.raw, state.problem), state.optimizer
            state = self._advance(state, step, new, seen, memory)
            recorder.record(state)
            state = recorder.drop(state)
            for callback in self.callbacks:
                state = callback.on_step(state)
                check_state(callback, state)
            if len(state.problem) == 0:
                break
        result = recorder.result(state, self.selector, objective.num_evaluations)
        _log.debug("%d steps drew %d pictures; energies %s", step, objective.num_evaluations, result.energy.tolist())
        for callback in self.callbacks:
            callback.on_end(result)
        return result

    def _seeds(self, observation: Observation, seed: int) -> Tensor:
        keys, starts = observation.keys or (0,) * observation.num_problems, range(self.num_starts)
        seeds = [mixed_seed(seed, key, f"optimizer/{start}") for key in keys for start in starts]
        return torch.tensor(seeds, device=observation.image.device)

    def _advance(self, state: FitState, step: int, new: Variables, seen: Evaluation, memory: Any) -> FitState:
        better = seen.ranking < state.best_energy  # False where the energy is NaN
        best = {
            name: value
            if not state.best_values
            else torch.where(broadcast_rows(better, value), value, state.best_values[name])
            for name, value in seen.values.items()
        }
        broken = ~(torch.isfinite(seen.energy) & finite(new))
        return replace(
            state,
            step=step,
            raw=new,
            values=seen.values,
            energy=torch.where(broken, torch.nan, seen.energy),
            terms=seen.terms,
            best_energy=torch.where(better, seen.ranking, state.best_energy),
            best_values=best,
            optimizer=memory,
        )
