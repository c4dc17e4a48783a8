"""What a pipeline's optimizer is told."""

import pytest
import torch

from kfit.core import Energy, Observation, Prior
from kfit.energies import L1, L2, CodePrior
from kfit.fitting.objective import Objective
from kfit.fitting.prepared_terms import PreparedTerms
from kfit.generators import Template

RAW = {"roll": torch.tensor([0.05, -0.1, 0.2]), "shift": torch.full((3, 2), 0.1), "scale": torch.zeros(3)}
PROBLEM = torch.tensor([0, 1, 0])


class Watched(Energy):
    """L1, and whether it was differentiated."""

    def __init__(self):
        super().__init__()
        self.graphs = []

    def compare(self, prediction, prepared):
        found = (prediction - prepared["target"]).abs().mean((1, 2, 3))
        self.graphs.append(found.requires_grad)
        return found


def objective(terms, weights, rank_weights=None):
    pictures = torch.rand(3, 3, 8, 8, generator=torch.Generator().manual_seed(0))
    prepared = PreparedTerms(Template(pictures[2], "similarity"), terms, Observation(pictures[:2]))
    return Objective(prepared, weights, rank_weights or weights, 0.25)


@pytest.mark.parametrize(("need", "graph"), [("value", False), ("residuals", False), ("gradient", True)])
def test_only_gradients_build_a_graph(need, graph):
    watched = Watched()
    evaluation = objective(
        {"l2": L2(), "seen": watched}, {"l2": 1.0, "seen": 0.0 if need == "residuals" else 1.0}, {"seen": 1.0}
    )(RAW, PROBLEM, need)
    assert watched.graphs == [graph]
    assert not any(term.requires_grad for term in evaluation.terms.values())
    assert not evaluation.rendering.image.requires_grad
    assert hasattr(evaluation, "gradient") == graph


def test_a_term_that_only_ranks_is_compared_and_not_differentiated():
    watched = Watched()
    evaluate = objective({"l2": L2(), "ranks": watched}, {"l2": 1.0, "ranks": 0.0}, {"ranks": 2.0})
    evaluation = evaluate(RAW, PROBLEM, "gradient")
    assert watched.graphs == [False]
    torch.testing.assert_close(evaluation.ranking, 2 * evaluation.terms["ranks"])
    torch.testing.assert_close(evaluation.energy, evaluation.terms["l2"])
    alone = objective({"l2": L2()}, {"l2": 1.0})(RAW, PROBLEM, "gradient")
    for name, slope in alone.gradient.items():
        torch.testing.assert_close(evaluation.gradient[name], slope)


def test_the_slope_is_zero_where_no_term_has_a_weight():
    evaluation = objective({"l2": L2()}, {"l2": 0.0}, {"l2": 1.0})(RAW, PROBLEM, "gradient")
    assert all((slope == 0).all() for slope in evaluation.gradient.values())
    assert (evaluation.energy == 0).all()


def test_residuals_square_to_the_energy_with_its_weights_and_priors():
    terms = {"l2": L2(), "prior": CodePrior("shift"), "ranks": L1()}
    evaluate = objective(terms, {"l2": 3.0, "prior": 0.5, "ranks": 0.0}, {"ranks": 1.0})
    evaluation, plain = (evaluate(RAW, PROBLEM, need) for need in ("residuals", "value"))
    assert evaluation.residuals.shape == (3, 3 * 64 + 2 + 1)  # a column for what is missing of the least overlap
    torch.testing.assert_close(evaluation.residuals.square().sum(1), plain.energy)
    torch.testing.assert_close(evaluation.energy, plain.energy)
    for name, term in plain.terms.items():
        torch.testing.assert_close(evaluation.terms[name], term)


@pytest.mark.parametrize(
    ("terms", "weights"),
    [({"l2": L2(), "l1": L1()}, {"l2": 1.0, "l1": 1.0}), ({"l2": L2(), "l1": L2()}, {"l2": 1.0, "l1": -1.0})],
)
def test_residuals_of_what_is_no_sum_of_squares_are_an_error_that_names_it(terms, weights):
    with pytest.raises(ValueError, match=r"sums of squares with weights above 0; 'l1' is not one, those that are: l2"):
        objective(terms, weights)(RAW, PROBLEM, "residuals")


def test_a_prior_of_no_squares_is_an_error_too():
    class Wish(Prior):
        on = "roll"

        def forward(self, value):
            return value

    with pytest.raises(ValueError, match="'wish' is not one"):
        objective({"l2": L2(), "wish": Wish()}, {"l2": 1.0, "wish": 1.0})(RAW, PROBLEM, "residuals")


def test_there_are_no_residuals_where_no_term_has_a_weight():
    evaluation = objective({"l2": L2()}, {"l2": 0.0}, {"l2": 1.0})(RAW, PROBLEM, "residuals")
    assert evaluation.residuals.abs().max() == 0


def test_the_rendering_is_what_was_drawn():
    evaluate = objective({"l2": L2()}, {"l2": 1.0})
    evaluation = evaluate(RAW, PROBLEM)
    torch.testing.assert_close(evaluation.rendering.image, evaluate.prepared.generator(**evaluation.values).image)
    assert evaluate.prepared.num_evaluations == 3


@pytest.mark.parametrize("need", ["value", "residuals", "gradient"])
@pytest.mark.parametrize("chunk", [1, 2])
def test_rows_are_drawn_in_even_chunks_and_none_notices(need, chunk):
    terms, weights = {"l2": L2(), "prior": CodePrior("shift")}, {"l2": 1.0, "prior": 0.1}
    at_once, drawn = objective(terms, weights), []
    in_parts = objective(terms, weights)
    in_parts.prepared.chunk = chunk
    in_parts.prepared.generator.register_forward_hook(lambda module, args, found: drawn.append(len(found.image)))
    whole, parts = at_once(RAW, PROBLEM, need), in_parts(RAW, PROBLEM, need)
    assert max(drawn) <= chunk
    assert sum(drawn) == in_parts.prepared.num_evaluations == 3
    for name, tensor in vars(whole).items():
        if name == "rendering":
            torch.testing.assert_close(parts.rendering.image, tensor.image)
        else:
            torch.testing.assert_close(getattr(parts, name), tensor)


def test_a_chunk_holds_fewer_pictures_the_larger_they_are():
    def chunk(side):
        picture = torch.zeros(1, 3, side, side)
        return PreparedTerms(Template(picture[0], "similarity"), {"l2": L2()}, Observation(picture)).chunk

    assert [chunk(64), chunk(128), chunk(1024)] == [16, 4, 1]


class Mixed(Energy):
    """Whether it was compared under autocast, and the precision of what it was handed."""

    def __init__(self, mixed):
        super().__init__()
        self.mixed, self.recorded = mixed, []

    def compare(self, prediction, prepared):
        self.recorded.append((torch.is_autocast_enabled("cpu"), prediction.dtype))
        return (prediction - prepared["target"]).square().mean((1, 2, 3))


def test_under_autocast_only_energies_that_say_so_compare_in_it():
    plain, mixed = Mixed(False), Mixed(True)
    evaluate = objective({"plain": plain, "mixed": mixed}, {"plain": 1.0, "mixed": 1.0})
    with torch.autocast("cpu", torch.bfloat16):
        evaluate(RAW, PROBLEM, "gradient")
    assert plain.recorded == [(False, torch.float32)]
    assert mixed.recorded == [(True, torch.float32)]
