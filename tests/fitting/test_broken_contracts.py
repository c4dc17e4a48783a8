"""Parts that break their contract are refused in one sentence, with the remedy."""

import pytest
import torch

from kfit import FitPipeline
from kfit.core import (
    Callback,
    Energy,
    FitState,
    Generator,
    Observation,
    Optimizer,
    Prior,
    Rendering,
    ResidualEnergy,
    Selector,
    Variable,
)
from kfit.energies import L1, L2, Perceptual
from kfit.initializers import Constant
from kfit.optimizers import CMAES, Adam, LevenbergMarquardt


class Grey(Generator):
    def __init__(self):
        super().__init__()
        self.variables = {"grey": Variable()}

    def forward(self, **values):
        return Rendering(values["grey"].view(-1, 1, 1, 1).expand(-1, 3, 8, 8))


def pipeline(**changes):
    parts = {
        "generator": Grey(),
        "energies": {"l1": L1()},
        "initializers": [Constant({"grey": 0.2})],
        "optimizer": Adam(0.1),
        "num_starts": 2,
        "num_steps": 2,
    }
    return FitPipeline(**parts | changes)


def fit(**changes):
    return pipeline(**changes)(Observation(torch.rand(2, 3, 8, 8)), seed=0)


class Still(Grey):
    def __init__(self):
        super().__init__()
        self.variables = {}


def test_an_energy_that_overrides_forward_is_refused_because_no_fit_calls_it():
    class Halved(L1):
        def forward(self, *args, **kwargs):
            return super().forward(*args, **kwargs) / 2

    with pytest.raises(TypeError, match=r"energies\.l1: Halved has a `forward` of its own, .* define `compare`"):
        fit(energies={"l1": Halved()})


def test_the_repr_of_a_pipeline_shows_all_of_its_parts_and_numbers():
    shown = repr(pipeline())
    for part in ("Constant(values={'grey': 0.2}", "Adam(rates=0.1", "num_starts=2", "LowestEnergy()", "L1("):
        assert part in shown


@pytest.mark.parametrize(
    ("changes", "error", "sentence"),
    [
        ({"energies": L1()}, TypeError, r'energies must be a dict of energies by name, got L1: \{"l1": L1\(…\)\}'),
        ({"energies": [L1()]}, TypeError, "energies must be a dict of energies by name, got list"),
        ({"energies": {}}, ValueError, "energies must name at least one energy"),
        ({"energies": {"l1": L1}}, TypeError, r"energies.l1 must be .* got the class L1: build it, L1\(…\)"),
        (
            {"energies": {"mse": torch.nn.MSELoss()}},
            TypeError,
            "energies.mse must be a kfit.core.Energy or a kfit.core.Prior, got MSELoss: .* subclass with `compare`",
        ),
        ({"generator": torch.nn.Linear(1, 1)}, TypeError, "generator must be a kfit.core.Generator, got Linear"),
        ({"generator": Still()}, ValueError, "generator: Still has no variables, so there is nothing to fit"),
        (
            {"optimizer": torch.optim.AdamW},
            TypeError,
            "optimizer must be a kfit.core.Optimizer, got the class AdamW: kfit.optimizers.TorchOptimizer wraps",
        ),
        (
            {"optimizer": torch.optim.SGD([torch.zeros(1, requires_grad=True)], lr=0.1)},
            TypeError,
            "optimizer must be a kfit.core.Optimizer, got SGD: kfit.optimizers.TorchOptimizer wraps",
        ),
        (
            {"initializers": Constant({"grey": 0.2})},
            TypeError,
            r"initializers must be a list of kfit.core.Initializer, got Constant: \[Constant\(…\)\]",
        ),
        ({"initializers": [0.2]}, TypeError, r"initializers\[0\] must be a kfit.core.Initializer, got float"),
        ({"callbacks": [print]}, TypeError, r"callbacks\[0\] must be a kfit.core.Callback, got builtin"),
        ({"selector": min}, TypeError, "selector must be a kfit.core.Selector, got builtin"),
    ],
)
def test_a_part_of_the_wrong_kind_is_refused_when_the_fit_is_built(changes, error, sentence):
    with pytest.raises(error, match=sentence):
        fit(**changes)


def test_a_tensor_is_no_observation():
    pipeline = FitPipeline(Grey(), {"l1": L1()}, [Constant({"grey": 0.2})], Adam(0.1))
    with pytest.raises(TypeError, match=r"observation must be a kfit.core.Observation, got Tensor: .*Observation\(pic"):
        pipeline(torch.rand(1, 3, 8, 8))


def test_a_tensor_is_no_rendering():
    class Bare(Grey):
        def forward(self, **values):
            return super().forward(**values).image

    with pytest.raises(TypeError, match=r"Bare.forward returns must be .*Rendering, got Tensor: return kfit"):
        fit(generator=Bare())


@pytest.mark.parametrize(("shape", "came"), [((), r"\(\)"), ((-1, 1), r"\(4, 1\)"), ((2, 2), r"\(2, 2\)")])
def test_an_energy_gives_one_number_a_row(shape, came):
    class Wrong(Energy):
        def compare(self, prediction, prepared):
            found = (prediction - prepared["target"]).abs().mean((1, 2, 3))
            return found.mean() if shape == () else found.view(shape)

    with pytest.raises(ValueError, match=rf"energies.w: Wrong.compare must return shape \(4,\), got {came}: average"):
        fit(energies={"w": Wrong()})


def test_a_prior_gives_one_number_a_row():
    class Wrong(Prior):
        on = "grey"

        def forward(self, value, prepared=None):
            return value.square().sum()

    with pytest.raises(ValueError, match=r"energies.p: Wrong.forward must return shape \(4,\), got \(\)"):
        fit(energies={"l1": L1(), "p": Wrong()})


def test_residuals_are_a_row_each():
    class Wrong(ResidualEnergy):
        def residuals(self, prediction, prepared):
            return (prediction - prepared["target"]).flatten()

        def compare(self, prediction, prepared):
            return L2().compare(prediction, prepared)

    with pytest.raises(ValueError, match=r"energies.w: Wrong.residuals must return shape \(8, M\), got \(1536,\)"):
        fit(energies={"w": Wrong()}, optimizer=LevenbergMarquardt())


@pytest.mark.parametrize("energy", [L1(), Perceptual(torch.nn.Conv2d(3, 4, 3, 2))], ids=["L1", "Perceptual"])
def test_drawings_have_the_size_of_the_observation(energy):
    class Small(Grey):
        def forward(self, **values):
            return super().forward(**values).map(lambda image: image[..., :7])

    with pytest.raises(ValueError, match=r"energies.e: the drawn image must have shape \(3, 8, 8\) .* got \(3, 8, 7\)"):
        fit(generator=Small(), energies={"e": energy})


class TestAGradientThatReachesNoVariable:
    def test_names_it(self):
        class Detached(Grey):
            def __init__(self):
                super().__init__()
                self.variables = {"grey": Variable(), "tint": Variable()}

            def forward(self, **values):
                image = super().forward(grey=values["grey"]).image
                return Rendering(image + values["tint"].detach().view(-1, 1, 1, 1))

        starts = [Constant({"grey": 0.2, "tint": 0.0})]
        with pytest.raises(ValueError, match=r"no gradient reaches tint through Detached: .* kfit.optimizers.CMAES"):
            fit(generator=Detached(), initializers=starts)
        assert fit(generator=Detached(), initializers=starts, optimizer=CMAES()).energy.isfinite().all()

    def test_names_all_where_nothing_is_reached(self):
        class Rounded(Grey):
            def forward(self, **values):
                return super().forward(grey=values["grey"].detach())

        with pytest.raises(ValueError, match="no gradient reaches grey through Rounded"):
            fit(generator=Rounded())

    def test_is_none_where_the_energies_only_leave_a_variable_out(self):
        class Masked(Grey):
            def __init__(self):
                super().__init__()
                self.variables = {"grey": Variable(), "size": Variable()}

            def forward(self, **values):
                drawn = super().forward(grey=values["grey"])
                return Rendering(drawn.image, values["size"].view(-1, 1, 1, 1).expand(-1, 1, 8, 8))

        assert fit(generator=Masked(), initializers=[Constant({"grey": 0.2, "size": 0.0})]).energy.isfinite().all()


def test_a_callback_returns_the_state():
    class Forgetful(Callback):
        def on_step(self, state: FitState) -> FitState:
            self.recorded = state.step

    with pytest.raises(
        TypeError, match=r"Forgetful.on_step returns must be a .*FitState, got NoneType: .*return state"
    ):
        fit(callbacks=[Forgetful()])


@pytest.mark.parametrize(
    ("rows", "error", "sentence"),
    [
        (lambda problem: torch.tensor([3, 0]), ValueError, "Chooses returned a row of problem 1 as the winner of 0"),
        (
            lambda problem: torch.tensor([0]),
            ValueError,
            r"Chooses must return one row of each problem, \(2,\), got \(1,",
        ),
        (lambda problem: torch.tensor([0, 9]), ValueError, r"Chooses must return rows 0 to 3, got \[0, 9\]"),
        (lambda problem: torch.tensor([0.0, 2.0]), TypeError, "Chooses must return numbers of rows, a long tensor"),
        (lambda problem: [0, 2], TypeError, "Chooses must return numbers of rows, .* got list"),
    ],
)
def test_a_selector_picks_one_row_of_each_problem(rows, error, sentence):
    class Chooses(Selector):
        def __call__(self, energy, values, problem):
            return rows(problem)

    with pytest.raises(error, match=sentence):
        fit(selector=Chooses())


class TestAnOptimizersMemory:
    @pytest.mark.parametrize(("tensor", "shape"), [(torch.tensor(0.1), r"\(\)"), (torch.zeros(5, 3), r"\(5, 3\)")])
    def test_leads_with_rows_from_the_start(self, tensor, shape):
        class Counts(Adam):
            def init(self, raw, seeds):
                return {"adam": super().init(raw, seeds), "count": [tensor]}

        with pytest.raises(
            ValueError, match=rf"memory of Counts must lead with rows, 2 here, got shape {shape} at mem"
        ):
            fit(optimizer=Counts())

    def test_leads_with_rows_after_each_step(self):
        class Grows(Optimizer):
            def init(self, raw, seeds):
                return {"mean": raw["grey"]}

            def step(self, evaluate, raw, problem, memory):
                return raw, evaluate(raw, problem, need="gradient"), {"mean": memory["mean"].mean()}

        with pytest.raises(ValueError, match=r"memory of Grows must lead with rows, 4 here, got shape \(\) at memory"):
            fit(optimizer=Grows())
