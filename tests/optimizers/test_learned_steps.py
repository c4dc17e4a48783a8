"""Steps that a network predicts: they move the pose as it says, and nothing else."""

import pytest
import torch

from kfit import FitPipeline
from kfit.core import Angle, Generator, Observation, Rendering, Variable
from kfit.energies import L2
from kfit.generators import SimilarityWarp
from kfit.geometry import PoseUpdate, RefinerNetwork, rotation_error
from kfit.geometry.pose import rotation_of
from kfit.initializers import Constant
from kfit.optimizers import Adam, LearnedSteps, Stages


class Fixed(Generator):
    """Paints its rotation and a code into a picture, so that a network can read them off."""

    def __init__(self):
        super().__init__()
        self.variables = {"code": Variable(), "azimuth": Variable((), Angle()), "elevation": Variable((), Angle())}

    def forward(self, **values):
        image = torch.stack([values["azimuth"], values["elevation"], values["code"]], 1)[..., None, None]
        image = image.expand(-1, 3, 8, 8) / 10
        return Rendering(image, torch.ones_like(image[:, :1]))


INPUTS = []
"""What the network has seen."""


class Always(RefinerNetwork):
    """Predicts one update, whatever it sees."""

    def __init__(self, rotation=(0.0, 0.0, 0.0), shift=(0.0, 0.0), log_scale=0.0):
        super().__init__()
        step = torch.tensor([*rotation, *shift, log_scale])
        self.register_buffer("step", step)

    def forward(self, observed, drawn):
        INPUTS.append((observed, drawn))
        step = self.step.expand(len(observed), 6)
        return PoseUpdate(step[:, :3], step[:, 3:5], step[:, 5], 0 * step[:, :4], 0 * step[:, 0])


START = {"code": 0.5, "azimuth": 3.1, "elevation": 0.4, "roll": 0.2, "shift": [0.1, 0.0], "scale": 1.2}


def fit(optimizer, steps=1, observation=None):
    pipeline = FitPipeline(
        SimilarityWarp(Fixed()), {"look": L2()}, [Constant(START)], optimizer, num_starts=2, num_steps=steps
    )
    result = pipeline(observation or Observation(torch.zeros(1, 3, 8, 8), torch.ones(1, 1, 8, 8)), seed=0)
    return {name: value[-1] for name, value in result.history.values.items()}


def test_a_step_turns_in_the_cameras_axes_shifts_and_scales():
    values = fit(LearnedSteps(Always((0.1, -0.2, 0.3), (0.05, -0.1), 0.2)))
    found = {name: value[0] for name, value in values.items()}
    start = {name: torch.tensor([value, value]) for name, value in START.items() if name != "shift"}
    turn = torch.matrix_exp(torch.tensor([[0.0, -0.3, -0.2], [0.3, 0.0, -0.1], [0.2, 0.1, 0.0]]))
    assert float(rotation_error(rotation_of(found), turn @ rotation_of(start)).max()) < 1e-3
    torch.testing.assert_close(found["shift"], torch.tensor([[0.15, -0.1]] * 2))
    torch.testing.assert_close(found["scale"], torch.full((2,), 1.2 * torch.tensor(0.2).exp()))
    assert found["code"].tolist() == [0.5, 0.5]


def test_angles_go_the_short_way_round():
    azimuth = fit(LearnedSteps(Always((0.0, 0.3, 0.0))))["azimuth"]
    assert (azimuth - START["azimuth"]).abs().max() < 0.5


def test_a_descent_continues_where_learned_steps_have_led():
    values = fit(Stages([(LearnedSteps(Always(shift=(0.2, 0.0))), 1), (Adam(0.001), 2)]), steps=3)
    torch.testing.assert_close(values["shift"], torch.tensor([[[0.3, 0.0]] * 2]), rtol=0, atol=0.01)


def test_the_network_sees_photo_and_drawing_and_not_what_has_no_weight():
    INPUTS.clear()
    weight = torch.ones(1, 1, 8, 8)
    weight[..., 0] = 0
    photo = torch.full((1, 3, 8, 8), 0.25)
    fit(LearnedSteps(Always()), observation=Observation(photo, torch.ones(1, 1, 8, 8), weight=weight))
    ((observed, drawn),) = INPUTS
    assert observed.shape == drawn.shape == (2, 4, 8, 8)
    for found in (observed, drawn):
        assert (found[:, :3, :, 0] == 1).all()
        assert (found[:, 3, :, 0] == 0).all()
    assert (observed[:, :3, :, 1:] == 0.25).all()


def test_a_generator_without_a_pose_is_refused():
    optimizer = LearnedSteps(Always())
    with pytest.raises(ValueError, match="elevation, roll, shift, scale is missing"):
        FitPipeline(Flat(), {"look": L2()}, [Constant({"azimuth": 0.0})], optimizer)


def test_an_observation_without_a_mask_is_refused():
    with pytest.raises(ValueError, match="needs masks"):
        fit(LearnedSteps(Always()), observation=Observation(torch.zeros(1, 3, 8, 8)))


def test_a_pipeline_moves_its_network():
    optimizer = Stages([(LearnedSteps(Always()), 1), (Adam(), 1)])
    pipeline = FitPipeline(SimilarityWarp(Fixed()), {"look": L2()}, [Constant(START)], optimizer)
    pipeline.to(torch.float64)
    assert pipeline.optimizer.stages[0][0].refiner.step.dtype == torch.float64


class Flat(Generator):
    def __init__(self):
        super().__init__()
        self.variables = {"azimuth": Variable((), Angle())}

    def forward(self, **values):
        return Rendering(values["azimuth"].view(-1, 1, 1, 1).expand(-1, 3, 8, 8))
