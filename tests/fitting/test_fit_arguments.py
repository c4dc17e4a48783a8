"""What a fit is handed besides the observation, and what building a pipeline leaves alone."""

import pytest
import torch
from spot_fits import TRUTH, pipeline, spots
from torch import nn

from kfit.core import Callback, Initializer
from kfit.core.frozen import with_frozen_networks
from kfit.optimizers import Adam, Stages


class Counting(Callback):
    """Notes the steps that it is called at."""

    def __init__(self):
        self.steps = []

    def on_step(self, state):
        self.steps.append(state.step)
        return state

    def on_end(self, result):
        self.steps.append("end")


class Reading(Initializer):
    """Starts at what networks make of the picture."""

    on = ("x", "y", "radius", "angle")

    def __init__(self, network, more):
        self.network, self.more = network, more

    def __call__(self, variables, observation, num_starts, rngs):
        assert not self.network.training
        found = self.network(observation.image.flatten(1).to(torch.float32)).double().repeat_interleave(num_starts, 0)
        return dict(zip(self.on, (0.3 + 0.1 * found.sigmoid()).unbind(1), strict=True))


class TestStarts:
    def test_take_the_place_of_what_initializers_propose(self):
        truth = {name: torch.tensor(values, dtype=torch.float64) for name, values in TRUTH.items()}
        result = pipeline(num_starts=1, num_candidates=8, num_steps=0)(spots(), seed=0, starts=truth)
        for name, values in truth.items():
            torch.testing.assert_close(result.values[name], values)
        assert result.num_evaluations == 3
        assert float(result.energy.max()) < 1e-12

    def test_go_on_where_another_fit_ended(self):
        fit = pipeline()
        first = fit(spots(), seed=0)
        again = fit(spots(), seed=0, starts=first.all_values)
        torch.testing.assert_close(again.history.values["x"][0].flatten(), first.all_values["x"])
        assert bool((again.energy <= first.energy + 1e-9).all())

    @pytest.mark.parametrize(
        ("change", "words"),
        [
            ({"angle": None}, "starts: nothing for angle; the names are angle, radius, x, y"),
            ({"colour": torch.zeros(3)}, "starts: unknown colour"),
            ({"x": torch.zeros(2)}, r"starts must give 'x' in shape \(3,\), got \(2,\)"),
        ],
    )
    def test_of_other_names_or_shapes_are_refused(self, change, words):
        starts = {name: torch.tensor(values, dtype=torch.float64) for name, values in TRUTH.items()} | change
        with pytest.raises(ValueError, match=words):
            pipeline(num_starts=1)(spots(), starts={k: v for k, v in starts.items() if v is not None})


class TestCallbacksOfOneFit:
    def test_are_called_after_the_pipelines_own_and_in_that_fit_alone(self):
        own, once = Counting(), Counting()
        fit = pipeline(callbacks=[own], num_steps=2)
        fit(spots(), seed=0, callbacks=[once])
        fit(spots(), seed=0)
        assert once.steps == [0, 1, 2, "end"]
        assert own.steps == once.steps * 2

    def test_must_be_callbacks(self):
        with pytest.raises(TypeError, match=r"callbacks\[0\] must be a kfit.core.Callback, got the class Counting"):
            pipeline()(spots(), callbacks=[Counting])


class TestBuildingAPipeline:
    def networks(self):
        network = nn.Sequential(nn.Linear(3 * 256, 4), nn.BatchNorm1d(4), nn.Dropout(0.5))
        return network.train(), {"deep": [nn.Linear(2, 2)]}

    def test_leaves_the_networks_of_initializers_as_they_are(self):
        network, more = self.networks()
        fit = pipeline(initializers=[Reading(network, more)])
        fit.double().half()
        assert network.training
        assert more["deep"][0].training
        assert {p.dtype for p in network.parameters()} == {torch.float32}
        assert all(p.requires_grad for p in network.parameters())
        assert {p.dtype for p in fit.networks.parameters()} == {torch.float16}
        assert not any(p.requires_grad for p in fit.networks.parameters())
        assert len(fit.networks) == 2

    def test_has_initializers_read_by_networks_in_evaluation_mode(self):
        network, more = self.networks()
        first, again = (pipeline(initializers=[Reading(network, more)])(spots(), seed=0) for _ in range(2))
        assert torch.equal(first.all_energy, again.all_energy)

    def test_shares_the_weights_of_an_initializers_networks(self):
        network, more = self.networks()
        part = Reading(network, more)
        twin = with_frozen_networks(part)
        assert twin.network is not network
        assert twin.network[0].weight.data_ptr() == network[0].weight.data_ptr()
        assert part.network is network
        assert twin.settings == part.settings

    def test_holds_its_parts_in_tuples_that_nobody_can_add_to(self):
        fit = pipeline()
        assert isinstance(fit.callbacks, tuple)
        assert isinstance(fit.initializers, tuple)

    def test_freezes_the_networks_of_optimizers_also_in_stages(self):
        network = nn.Linear(1, 1).train()

        class Guided(Adam):
            def __init__(self, network):
                super().__init__(0.01)
                self.network = network

        fit = pipeline(optimizer=Stages([(Guided(network), 2), (Adam(0.01), 2)]))
        twin = fit.optimizer.stages[0][0].network
        assert twin is fit.networks[0]
        assert twin is not network
        assert twin.weight.data_ptr() == network.weight.data_ptr()
        assert network.training
        assert not twin.training
