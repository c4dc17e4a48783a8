"""Optimizers of torch.optim in a fit, held against torch's own loop."""

import pytest
import torch
from torch.utils import _pytree as pytree

from kfit import FitPipeline
from kfit.callbacks import Pruning
from kfit.core import Generator, Observation, Rendering, Variable
from kfit.energies import L2
from kfit.fitting.schedules import Cosine, Linear
from kfit.initializers import Uniform
from kfit.optimizers import TorchOptimizer

KINDS = {
    "Adam": (torch.optim.Adam, {}),
    "AdamW": (torch.optim.AdamW, {"weight_decay": 0.1}),
    "SGD": (torch.optim.SGD, {"momentum": 0.9, "nesterov": True}),
    "RMSprop": (torch.optim.RMSprop, {"centered": True}),
    "Adagrad": (torch.optim.Adagrad, {}),
    "Adadelta": (torch.optim.Adadelta, {}),
    "Adamax": (torch.optim.Adamax, {}),
    "NAdam": (torch.optim.NAdam, {}),
    "RAdam": (torch.optim.RAdam, {}),
    "Rprop": (torch.optim.Rprop, {}),
    "ASGD": (torch.optim.ASGD, {}),
    "Adafactor": (torch.optim.Adafactor, {}),
}


# One with momentum, one without, and one whose state is of another kind; the others wait for --runslow.
QUICK = ("Adam", "SGD", "Adafactor")
EACH = pytest.mark.parametrize(
    "name", [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in KINDS]
)


class Waves(Generator):
    """Two waves whose phases and height are unknown."""

    variables = {"phase": Variable((2,)), "height": Variable()}  # noqa: RUF012

    def forward(self, phase, height):
        grid = torch.linspace(0, 3, 12, dtype=phase.dtype)
        waves = (grid + phase[..., None]).sin().sum(1) * height[:, None]
        return Rendering(waves[:, None, None])


TARGET = Waves()(torch.tensor([[0.2, 1.0]]).double(), torch.tensor([1.3]).double()).image


def pipeline(optimizer, **settings):
    starts = [Uniform("phase", -1.0, 1.0), Uniform("height", 0.5, 1.5)]
    return FitPipeline(Waves(), {"l2": L2()}, starts, optimizer, **{"num_starts": 3, "num_steps": 12, **settings})


@EACH
def test_each_row_walks_the_path_of_torch_s_own_loop(name):
    kind, settings = KINDS[name]
    history = pipeline(TorchOptimizer(kind, 0.03, Cosine(1.0, 0.2), 10, settings))(Observation(TARGET), seed=1).history
    for row in range(3):
        leaves = {k: v[0, 0, row].clone().requires_grad_() for k, v in history.values.items()}
        own = kind([{"params": [leaf]} for leaf in leaves.values()], lr=0.03, **settings)
        falling = torch.optim.lr_scheduler.LambdaLR(own, lambda step: Cosine(1.0, 0.2)(min(step, 10), 10))
        for _ in range(12):
            own.zero_grad()
            drawn = Waves()(**{k: v[None] for k, v in leaves.items()}).image
            L2()(drawn, TARGET).sum().backward()
            own.step()
            falling.step()
        for variable, leaf in leaves.items():
            torch.testing.assert_close(history.values[variable][-1, 0, row], leaf.detach(), rtol=1e-9, atol=1e-9)


@EACH
def test_a_survivor_s_path_is_its_path_without_pruning(name):
    kind, settings = KINDS[name]
    optimizer = TorchOptimizer(kind, 0.03, settings=settings)
    whole = pipeline(optimizer)(Observation(TARGET), seed=1).history
    pruned = pipeline(optimizer, callbacks=[Pruning({4: 1})])(Observation(TARGET), seed=1)
    row = int(pruned.start[0])
    for variable, path in pruned.history.values.items():
        torch.testing.assert_close(path[:, 0, row], whole.values[variable][:, 0, row], rtol=1e-12, atol=1e-12)


def test_memory_leads_with_rows():
    optimizer = TorchOptimizer(torch.optim.AdamW, 0.1)
    raw = {"phase": torch.zeros(4, 2), "height": torch.zeros(4)}
    _, memory = optimizer._step(raw, raw, optimizer.init(raw, torch.arange(4)))
    tensors = [leaf for leaf in pytree.tree_leaves(memory) if isinstance(leaf, torch.Tensor)]
    assert len(tensors) == 7
    assert {len(tensor) for tensor in tensors} == {4}


def test_rates_by_variable_hold_one_at_zero():
    values = pipeline(TorchOptimizer(torch.optim.Adam, {"phase": 0.05, "height": 0.0}))(
        Observation(TARGET), seed=0
    ).history.values
    torch.testing.assert_close(values["height"][-1], values["height"][0], rtol=0, atol=0)
    assert not torch.equal(values["phase"][-1], values["phase"][0])


class Mixing(torch.optim.SGD):
    """Steps by the mean length of all gradients."""

    def step(self, closure=None):
        rows = [p for group in self.param_groups for p in group["params"]]
        length = sum(p.grad.norm() for p in rows) / len(rows)
        for p in rows:
            p.data -= 0.1 * p.grad / length


class InGroups(torch.optim.SGD):
    """Counts in its groups."""

    def step(self, closure=None):
        super().step()
        self.param_groups[0]["count"] = self.param_groups[0].get("count", 0) + 1


@pytest.mark.parametrize(
    ("build", "error", "message"),
    [
        (lambda: TorchOptimizer(torch.optim.LBFGS, 0.1), TypeError, "LBFGS needs a closure.*kfit.optimizers.LBFGS"),
        (lambda: TorchOptimizer(torch.nn.Linear, 0.1), TypeError, "must be a class like torch.optim.AdamW"),
        (lambda: TorchOptimizer(torch.optim.Adam, 0.0), ValueError, "lr must be above 0"),
        (lambda: TorchOptimizer(torch.optim.Adam, 0.1, lambda step: 1.0), TypeError, "schedule must be a kfit.core"),
        (lambda: pipeline(TorchOptimizer(torch.optim.Adam, {"phase": 0.1})), ValueError, "lr: nothing for height"),
        (lambda: pipeline(TorchOptimizer(Mixing, 0.1)), ValueError, "Mixing mixes its parameters"),
        (lambda: pipeline(TorchOptimizer(InGroups, 0.1)), TypeError, "InGroups remembers something"),
    ],
)
def test_an_optimizer_that_no_row_could_have_alone_is_refused(build, error, message):
    with pytest.raises(error, match=message):
        build()


def test_the_schedule_stays_at_its_end():
    optimizer = TorchOptimizer(torch.optim.SGD, 0.5, Linear(1.0, 0.0), num_steps=4)
    values = pipeline(optimizer)(Observation(TARGET), seed=0).history.values["phase"][:, 0, 0]
    assert bool((values[4:] == values[4]).all())
    assert not torch.equal(values[3], values[2])
