"""What a rendering vouches for: its weight in a fit, and rows that leave the frame."""

from dataclasses import replace

import pytest
import torch

from kfit import FitPipeline
from kfit.core import Generator, Observation, Rendering, Variable
from kfit.energies import L1, L2, NCC, SSIM, Gradient, LocalNCC, MutualInformation, Pyramid, Welsch
from kfit.fitting.objective import Objective
from kfit.fitting.prepared_terms import PreparedTerms
from kfit.generators import SimilarityWarp, Template
from kfit.initializers import Constant, Uniform
from kfit.optimizers import LBFGS, Adam, LevenbergMarquardt

ENERGIES = [L1(), L2(), Welsch(), SSIM(7), NCC(), LocalNCC(5), MutualInformation(16), Gradient(), Pyramid(L1(), 2)]
STILL = {"roll": 0.0, "shift": [0.0, 0.0], "scale": 1.0}


def picture(size=32):
    v, u = torch.meshgrid(torch.linspace(0, 5, size), torch.linspace(0, 6, size), indexing="ij")
    return torch.stack([0.5 + 0.3 * (u + k * v).sin() * (v - k).cos() for k in (0, 1, 2)])


def rows(*values):
    return {name: torch.stack([torch.as_tensor(value[name]) for value in values]) for name in values[0]}


def evaluate(energy, observation, values, min_overlap=0.25, need="value"):
    template = Template(picture(), "similarity")
    objective = Objective(
        PreparedTerms(template, {"look": energy}, observation), {"look": 1.0}, {"look": 1.0}, min_overlap
    )
    raw = {name: template.variables[name].space.to_raw(value) for name, value in values.items()}
    return objective(raw, torch.zeros(len(raw["roll"]), dtype=torch.long), need)


@pytest.mark.parametrize("energy", ENERGIES, ids=lambda energy: type(energy).__name__)
class TestWithAnyEnergy:
    def test_what_lies_outside_the_template_does_not_count(self, energy):
        drawn = Template(picture(), "similarity")(**rows({**STILL, "shift": [0.25, 0.0]}))
        for outside in (0.0, 1.0, torch.nan):
            target = torch.where(drawn.weight > 0, drawn.image, outside)
            observed = evaluate(energy, Observation(target), rows({**STILL, "shift": [0.25, 0.0]}))
            least = energy(drawn.image, drawn.image, drawn.weight)
            torch.testing.assert_close(observed.energy, least)

    def test_leaving_the_frame_never_wins(self, energy):
        out = [{**STILL, "shift": shift} for shift in ([1.9, 0.0], [1.7, 1.7], [5.0, 0.0], [0.0, -1.6])]
        small = [{**STILL, "scale": scale} for scale in (0.4, 0.05, 1e-3)]
        poor = {**STILL, "roll": 2.0, "shift": [0.4, 0.1]}
        observed = evaluate(energy, Observation(picture()[None].flip(2)), rows(poor, *out, *small))
        assert observed.ranking[0].isfinite()
        assert observed.ranking[1:].isinf().all()
        assert observed.energy.isfinite().all()

    def test_a_flat_picture_does_not_make_leaving_cheap(self, energy):
        observed = evaluate(
            energy, Observation(torch.full((1, 3, 32, 32), 0.5)), rows(STILL, {**STILL, "shift": [9.0, 0]})
        )
        assert observed.ranking.argmin() == 0


@pytest.mark.parametrize(
    "optimizer",
    [
        Adam(0.02),
        pytest.param(LBFGS(), marks=pytest.mark.slow),
        pytest.param(LevenbergMarquardt(), marks=pytest.mark.slow),
    ],
    ids=lambda optimizer: type(optimizer).__name__,
)
@pytest.mark.parametrize("energy", [L2(), NCC()], ids=lambda energy: type(energy).__name__)
def test_a_fit_from_many_starts_stays_in_the_frame_and_finds_the_shift(energy, optimizer):
    truth = {**STILL, "shift": [0.3, -0.2]}
    maker = Template(picture(96), "similarity")
    # another scene lies where the template does not reach
    drawn = maker(**rows(truth))
    observed = torch.where(drawn.weight > 0.999, drawn.image, picture(96).flip(0, 1))[..., 24:72, 24:72]
    template = Template(picture(96)[:, 24:72, 24:72], "similarity")
    starts = [Uniform("shift", -1.2, 1.2), Constant({"roll": 0.0, "scale": 1.0})]
    pipeline = FitPipeline(template, {"look": energy}, starts, optimizer, num_starts=24, num_steps=40)
    found = pipeline(Observation(observed), seed=0)
    expected = 2 * torch.tensor(truth["shift"])
    torch.testing.assert_close(found.values["shift"][0], expected, rtol=0, atol=0.03)
    lost = found.all_energy.isinf()
    assert found.all_energy[~lost].min() == found.energy


def test_the_penalty_leads_back_into_the_frame():
    values = rows({**STILL, "shift": [1.8, 0.0]})
    observed = evaluate(L2(), Observation(picture()[None]), values, need="gradient")
    assert observed.ranking.isinf()
    assert observed.gradient["shift"][0, 0] > 0.1
    free = evaluate(L2(), Observation(picture()[None]), values, min_overlap=0.0)
    assert free.ranking.isfinite()
    assert free.energy < observed.energy


@pytest.mark.parametrize("need", ["value", "gradient"])
def test_residuals_square_to_the_energy_with_its_penalty(need):
    values = rows(STILL, {**STILL, "shift": [1.7, 0.2]}, {**STILL, "shift": [0.4, 0.1]})
    observed = evaluate(NCC(), Observation(picture()[None].flip(2)), values, need=need)
    squares = evaluate(NCC(), Observation(picture()[None].flip(2)), values, need="residuals")
    torch.testing.assert_close(squares.residuals.square().sum(1), observed.energy)
    torch.testing.assert_close(squares.ranking, observed.ranking)


def test_the_gradient_is_that_of_the_energy_with_its_changing_overlap():
    template = Template(picture(16).double(), "similarity")
    observation = Observation(picture(16).double()[None].flip(2), weight=torch.rand(1, 1, 16, 16).double())
    objective = Objective(PreparedTerms(template, {"l2": L2()}, observation), {"l2": 2.0}, {"l2": 1.0}, 0.6)
    raw = {
        "roll": torch.tensor([0.1, 0.2]),
        "shift": torch.tensor([[0.21, -0.13], [0.7, 0.4]]),
        "scale": torch.zeros(2),
    }
    raw = {name: value.double() for name, value in raw.items()}
    problem, step = torch.zeros(2, dtype=torch.long), 1e-6
    slope = objective(raw, problem, "gradient").gradient["shift"][:, 0]
    moved = [
        objective(raw | {"shift": raw["shift"] + torch.tensor([sign * step, 0.0])}, problem).energy for sign in (1, -1)
    ]
    torch.testing.assert_close(slope, (moved[0] - moved[1]) / (2 * step), rtol=1e-4, atol=1e-7)


def test_the_observations_weight_and_the_renderings_multiply():
    values = rows({**STILL, "shift": [0.5, 0.0]})
    observed = picture()[None].flip(3)
    weight = torch.ones(1, 1, 32, 32)
    weight[..., :20, :] = 0
    hidden = torch.where(weight > 0, observed, torch.nan)
    drawn = Template(picture(), "similarity")(**values)
    found = evaluate(L2(), Observation(hidden, weight=weight), values)
    torch.testing.assert_close(found.energy, L2()(drawn.image, observed, weight * drawn.weight))


def test_overlap_is_of_what_the_observation_counts():
    weight = torch.zeros(1, 1, 32, 32)
    weight[..., :4] = 1
    values = rows({**STILL, "shift": [0.2, 0.0]}, {**STILL, "shift": [-0.2, 0.0]})
    found = evaluate(L2(), Observation(picture()[None], weight=weight), values)
    assert found.ranking.isinf().tolist() == [True, False]


def test_where_nothing_is_observed_no_row_wins():
    observed = evaluate(L2(), Observation(picture()[None], weight=torch.zeros(1, 1, 32, 32)), rows(STILL))
    assert observed.ranking.isinf().all()
    assert observed.energy.isfinite().all()


def test_a_generator_without_a_weight_is_compared_everywhere():
    class Plain(Generator):
        variables = {"grey": Variable()}  # noqa: RUF012

        def forward(self, **values):
            return Rendering(values["grey"].view(-1, 1, 1, 1).expand(-1, 3, 8, 8))

    objective = Objective(
        PreparedTerms(Plain(), {"l2": L2()}, Observation(torch.ones(1, 3, 8, 8))), {"l2": 1.0}, {"l2": 1.0}, 1.0
    )
    evaluation = objective({"grey": torch.tensor([0.5])}, torch.zeros(1, dtype=torch.long), "residuals")
    assert evaluation.residuals.shape == (1, 192)
    torch.testing.assert_close(evaluation.ranking, torch.tensor([0.25]))


def test_a_similarity_warp_counts_what_is_outside_and_keeps_hidden_colours_out():
    class Hidden(Generator):
        variables = {}  # noqa: RUF012

        def forward(self, **values):
            weight = torch.ones(1, 1, 32, 32)
            weight[..., 16:] = 0
            return Rendering(torch.where(weight > 0, picture()[None], torch.nan), weight=weight)

    drawn = SimilarityWarp(Hidden())(**rows({"roll": 0.0, "shift": [0.0, 0.5], "scale": 1.0}))
    assert drawn.image.isfinite().all()
    torch.testing.assert_close(drawn.weight[..., :, :16], torch.ones(1, 1, 32, 16))
    assert (drawn.weight[..., :24, 16:] == 0).all()
    assert (drawn.weight[..., 24:, 16:] == 1).all()
    torch.testing.assert_close(drawn.image[0, :, :24, :16], picture()[:, 8:, :16])
    plain = SimilarityWarp(Hidden())(**rows(STILL))
    assert replace(plain, weight=None).weight is None


@pytest.mark.parametrize("share", [-0.1, 1.5, "half"])
def test_a_least_overlap_must_be_a_share(share):
    with pytest.raises((TypeError, ValueError), match="min_overlap must"):
        FitPipeline(Template(picture(), "similarity"), {"l2": L2()}, [], Adam(0.1), min_overlap=share)


def test_a_fit_of_a_volume_compares_what_is_drawn_of_it():
    class Ball(Generator):
        variables = {"radius": Variable()}  # noqa: RUF012

        def forward(self, **values):
            axis = torch.linspace(-1, 1, 9)
            away = torch.stack(torch.meshgrid(axis, axis, axis, indexing="ij")).norm(dim=0)
            image = torch.sigmoid((values["radius"].view(-1, 1, 1, 1, 1) - away) / 0.1)
            half = torch.ones_like(image)
            half[:, :, 5:] = 0
            return Rendering(torch.where(half > 0, image, torch.nan), weight=half)

    target = Ball()(radius=torch.tensor([0.6, 0.4])).image.nan_to_num(0.3)
    start = [Uniform("radius", 0.2, 0.8)]
    for energy in (L2(), NCC()):
        fit = FitPipeline(Ball(), {"look": energy}, start, LevenbergMarquardt(), num_starts=2, num_steps=10)
        found = fit(Observation(target), seed=0).values["radius"]
        torch.testing.assert_close(found, torch.tensor([0.6, 0.4]), rtol=0, atol=1e-3)


def test_a_weight_that_is_no_number_makes_its_row_none():
    weight = torch.ones(1, 1, 32, 32)
    weight[..., 3, 3] = torch.nan
    assert evaluate(L2(), Observation(picture()[None], weight=weight), rows(STILL)).energy.isnan().all()
