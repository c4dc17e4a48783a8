"""The pose head is run once for one photo: starts, prior and confidence share its output."""

import numpy as np
import pytest
import torch

from kfit.core import Observation, frozen
from kfit.energies import PosePrior
from kfit.generators import PoseHead
from kfit.geometry import CATEGORIES
from kfit.geometry.pose_network import PoseNetwork, with_prediction
from kfit.initializers import PosePosterior
from kfit.pose import CategoryModel
from kfit.pose.observed_object import ObservedObject


@pytest.fixture
def model(tiny_model):
    torch.manual_seed(1)
    return CategoryModel(
        tiny_model.generator, tiny_model.encoder, tiny_model.extents, tiny_model.card, PoseHead().eval()
    )


@pytest.fixture
def runs(monkeypatch):
    """Pictures in each run of any pose head."""
    recorded, forward = [], PoseHead.forward
    monkeypatch.setattr(PoseHead, "forward", lambda self, image: (recorded.append(len(image)), forward(self, image))[1])
    return recorded


PHOTO, MASK = np.random.default_rng(0).random((40, 40, 3)), np.ones((40, 40))


def test_one_photo_takes_one_run_of_the_head(model, runs):
    model.pose(PHOTO, mask=MASK, pipeline=model.pipeline(2, 1))
    assert runs == [1]


def test_the_answer_is_that_of_three_runs(model):
    observed = ObservedObject.of(PHOTO, CATEGORIES["mug"], model.image_size, MASK)
    fit = model.pipeline(2, 1)
    alone = model.answer(fit(observed.observation, seed=0), observed, observed.observation)
    assert alone.to_dict() == model.pose(PHOTO, mask=MASK, pipeline=fit).to_dict()


def test_a_head_finds_its_own_output_and_no_other_heads(model, runs):
    observation = with_prediction(Observation(torch.rand(2, 3, 64, 64)), model.pose_head)
    runs.clear()
    known = frozen(model.pose_head).log_probabilities(observation)
    assert runs == []
    other = PoseHead().eval()
    assert not torch.equal(other.log_probabilities(observation), known)
    assert runs == [2]


def test_starts_and_prior_take_the_prediction(model, runs):
    image = torch.rand(2, 3, 64, 64)
    plain, read = Observation(image), with_prediction(Observation(image), model.pose_head)
    starts, prior = PosePosterior(model.pose_head), PosePrior(model.pose_head)
    expected, features = starts({}, plain, 3, []), prior.prepare(plain)
    runs.clear()
    for name, values in starts({}, read, 3, []).items():
        assert torch.equal(values, expected[name])
    assert torch.equal(prior.prepare(read), features)
    assert runs == []


def test_predictions_follow_the_problems_that_they_are_of(model):
    observation = with_prediction(Observation(torch.rand(4, 3, 64, 64), views=2), model.pose_head)
    (name,), (found,) = observation.predictions, observation.predictions.values()
    assert found.shape[0] == 2
    assert torch.equal(observation[1].predictions[name], found[1:])
    assert torch.equal(observation.first_views().predictions[name], found)
    assert torch.equal(Observation.cat([observation[1], observation[0]]).predictions[name], found.flip(0))
    assert observation.map(torch.Tensor.double).predictions[name].dtype == torch.float64
    with pytest.raises(ValueError, match="predictions: wrong must lead with the 1 problems, got 2"):
        Observation(torch.rand(1, 3, 8, 8), predictions={"wrong": found})


def test_a_head_without_weights_is_told_from_others_too():
    class Even(PoseNetwork):
        def __init__(self):
            bins = torch.linspace(-1.0, 1.0, 3)
            super().__init__(torch.zeros(1), bins, bins, "none", 0.1)

        def forward(self, image):
            return torch.zeros(len(image), 9).log_softmax(1)

    head, observation = Even(), Observation(torch.rand(1, 3, 8, 8))
    other = Even()
    assert head.prediction_name == frozen(head).prediction_name != other.prediction_name
    assert PosePosterior(head)({}, with_prediction(observation, head), 2, [])["azimuth"].shape == (2,)
