"""The pipeline: start, render, compare, step, select, for B problems × S starts at once."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from itertools import chain
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor, nn

from kfit.core import (
    Callback,
    Energy,
    FitResult,
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
from kfit.core.arguments import check_arguments
from kfit.core.check import check_count, check_names
from kfit.core.frozen import networks_of, with_frozen_networks
from kfit.features import FeatureNetwork
from kfit.fitting.check_outputs import check_memory, check_state
from kfit.fitting.check_parts import check_callbacks, check_candidates, check_observation, check_parts, check_weights
from kfit.fitting.objective import Objective
from kfit.fitting.prepared_terms import PreparedTerms
from kfit.fitting.recipe import recipe_text
from kfit.fitting.recorder import Recorder
from kfit.fitting.starts import initialize, likeliest, raw_starts, row_seeds
from kfit.fitting.state import advanced, first_state
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
        energies: Mapping[str, Energy | Prior],
        initializers: Sequence[Initializer],
        optimizer: Optimizer,
        weights: Mapping[str, float | Schedule] | None = None,
        rank_weights: Mapping[str, float] | None = None,
        selector: Selector | None = None,
        callbacks: Sequence[Callback] = (),
        num_starts: int = 32,
        num_steps: int = 50,
        num_candidates: int | None = None,
        history: bool | int = True,
        min_overlap: float = 0.25,
    ) -> None:
        super().__init__()
        check_arguments(FitPipeline, locals(), num_steps=(0,), min_overlap=(0, 1))
        check_candidates(num_candidates, num_starts)
        check_parts(generator, energies, initializers, optimizer, selector, callbacks)
        check_weights(energies, weights, rank_weights)
        self.generator: Generator = frozen(generator)
        self.energies = frozen(nn.ModuleDict(energies))
        self.initializers = tuple(with_frozen_networks(initializer) for initializer in initializers)
        self.optimizer = with_frozen_networks(optimizer)
        self.weights: dict[str, float | Schedule] = {**dict.fromkeys(energies, 1.0), **(weights or {})}
        self.selector, self.callbacks = selector or LowestEnergy(), tuple(callbacks)
        self.num_starts, self.num_steps, self.history, self.min_overlap = num_starts, num_steps, history, min_overlap
        self.rank_weights, self.num_candidates = rank_weights, num_candidates or num_starts
        if not any((rank_weights or self.weights_at(num_steps)).values()):
            raise ValueError("rank_weights must hold a number other than 0, or no start is better than another")
        # Initializers and optimizers are no modules: their networks are registered here, so that `to` moves them too.
        self.networks = nn.ModuleList(chain.from_iterable(map(networks_of, (*self.initializers, self.optimizer))))
        self.eval()
        zeros = {name: torch.zeros(2, *v.raw_shape) for name, v in generator.variables.items()}
        check_memory(optimizer, optimizer.init(zeros, torch.zeros(2, dtype=torch.long)), 2)

    def extra_repr(self) -> str:
        """Return the parts that are no modules, and the numbers, one a line."""
        return "\n".join(f"{k}={v!r}" for k, v in vars(self).items() if k[0] != "_" and k != "training")

    def train(self, mode: bool = True) -> FitPipeline:
        """Stay in evaluation mode, also inside of a module in training, because the networks are frozen."""
        return super().train(False)

    def to_yaml(self) -> str:
        """Return the recipe that ``kfit pose --fit`` and `kfit.pose.fit_recipe.fit_of` read, without the generator.

        A fit that is read from it gives the same numbers, bit by bit. Only what differs from the defaults is written.

        Raises:
            ValueError: naming a part that text cannot hold (built from a network, or of a class without import path).
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

    if TYPE_CHECKING:

        def __call__(
            self, observation: Observation, *, seed: int | None = None, starts: Variables | None = None,
            callbacks: Sequence[Callback] = (),
        ) -> FitResult: ...  # fmt: skip

    @property
    def device(self) -> torch.device:
        """Device of its networks."""
        return next(chain(self.parameters(), self.buffers(), [torch.empty(0)])).device

    def weights_at(self, step: int) -> dict[str, float]:
        """Return the weights of the terms at a step, 0 to ``num_steps``."""
        return {k: w(step, self.num_steps) if isinstance(w, Schedule) else w for k, w in self.weights.items()}

    @property
    def terms(self) -> dict[str, Energy | Prior]:
        """Its energies and priors by name."""
        return dict(self.energies.items())  # type: ignore[arg-type]

    @safe_after_fork()
    def forward(
        self,
        observation: Observation,
        *,
        seed: int | None = None,
        starts: Variables | None = None,
        callbacks: Sequence[Callback] = (),
    ) -> FitResult:
        """Fit B problems.

        Args:
            observation: the pictures to explain.
            seed: with the problems' keys it determines every random number, at least 0; drawn from torch's generator
                by default.
            starts: values (B · S, \\*shape) of all variables, the S starts of a problem consecutively, instead of those
                that the initializers set.
            callbacks: callbacks of this fit only, called after the pipeline's own.

        Raises:
            ValueError: if the observation has no pictures, or lacks a field that an energy compares, and for starts of
                other names or shapes.
            FitError: if every start of every problem became NaN or infinite.
        """
        check_observation(observation)
        check_callbacks(callbacks)
        check_count("seed", 0 if seed is None else seed, 0)
        # `trainer.predict` enables inference mode, in which gradients are not available.
        with torch.inference_mode(False), torch.no_grad():
            if any(tensor.is_inference() for tensor in vars(observation).values() if isinstance(tensor, Tensor)):
                observation = observation.map(Tensor.clone)
            return self._fit(observation, seed, starts, (*self.callbacks, *callbacks))

    def _fit(
        self, observation: Observation, seed: int | None, starts: Variables | None, callbacks: Sequence[Callback]
    ) -> FitResult:
        seed = int(torch.randint(2**31, ())) if seed is None else seed
        prepared = PreparedTerms(self.generator, self.terms, observation)
        variables = self.generator.variables
        if starts is None:
            proposed = initialize(self.initializers, variables, observation.first_views(), self.num_candidates, seed)
            raw = likeliest(self._objective(prepared, 0), proposed, self.num_candidates, self.num_starts)
        else:
            check_names("starts", starts, variables, complete=True)
            raw = raw_starts("starts", starts, variables, observation, self.num_starts)
        memory = self.optimizer.init(raw, row_seeds(observation, self.num_starts, seed))
        state = first_state(raw, memory, observation.num_problems, self.num_starts, self.num_steps)
        for callback in callbacks:
            callback.on_start(state)
        recorder = Recorder(observation.num_problems, self.num_starts, int(self.history))
        for step in range(self.num_steps + 1):
            objective = self._objective(prepared, step)
            if step < self.num_steps:
                new, evaluation, memory = self.optimizer.step(objective, state.raw, state.problem, state.optimizer)
                check_memory(self.optimizer, memory, len(state.problem))
            else:  # the last iterate is only evaluated
                new, evaluation, memory = state.raw, objective(state.raw, state.problem), state.optimizer
            state = advanced(state, step, new, evaluation, memory)
            recorder.record(state)
            state = recorder.drop(state)
            for callback in callbacks:
                state = callback.on_step(state)
                check_state(callback, state)
            if len(state.problem) == 0:
                break
        result = recorder.result(state, self.selector, prepared.num_evaluations)
        _log.debug("%d steps drew %d pictures; energies %s", step, prepared.num_evaluations, result.energy.tolist())
        for callback in callbacks:
            callback.on_end(result)
        return result

    def _objective(self, prepared: PreparedTerms, step: int) -> Objective:
        rank_weights = self.rank_weights or self.weights_at(self.num_steps)
        return Objective(prepared, self.weights_at(step), rank_weights, self.min_overlap)
