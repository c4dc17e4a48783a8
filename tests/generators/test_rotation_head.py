from __future__ import annotations

import math

import pytest
import torch

from kfit.core import Observation, Rendering
from kfit.generators import RotationHead
from kfit.generators.similarity_warp import warp
from kfit.geometry import rotation_error, rotation_from_angles
from kfit.geometry.pose import rotation_of
from kfit.initializers import PosePosterior


def small(symmetry: str = "none", **settings: float) -> RotationHead:
    torch.manual_seed(0)
    return RotationHead(
        symmetry, channels=(8, 16), hidden_dim=32, bin_deg=30.0, sigma_deg=15.0, image_size=16, **settings
    )


@pytest.mark.parametrize(("symmetry", "bins"), [("none", 12 * 12 * 6), ("y", 12 * 6)])
def test_gives_log_probabilities_over_bins_of_all_rotations(symmetry, bins) -> None:
    log_probability = small(symmetry)(torch.rand(2, 3, 16, 16))
    assert log_probability.shape == (2, bins)
    torch.testing.assert_close(log_probability.exp().sum(1), torch.ones(2))


def test_turning_the_picture_by_a_right_angle_turns_the_distribution() -> None:
    head = small(upright=0.0).eval()
    image = torch.rand(1, 3, 16, 16)
    there, rotated = (head(picture).view(12, -1) for picture in (image, image.rot90(1, (2, 3))))
    torch.testing.assert_close(rotated, there.roll(3, 0), rtol=1e-3, atol=1e-3)


def test_standing_objects_are_likelier_by_the_prior_alone() -> None:
    image = torch.rand(1, 3, 16, 16)
    heads = small(upright=0.0), small(upright=0.5)
    without, with_prior = (head(image).detach().view(12, -1).logsumexp(1) for head in heads)
    ratio = (with_prior - without).exp()
    # 30° bins: e⁰ and twice e^−2 of the standing half, and a twelfth of the other.
    standing = 1 / (1 + 2 * math.exp(-2) + 2 * math.exp(-8))
    assert float(ratio[0] / ratio[6]) == pytest.approx((0.5 * standing + 0.5 / 12) / (0.5 / 12), rel=1e-3)
    assert float(with_prior.exp().sum()) == pytest.approx(1, abs=1e-4)


def test_the_kernel_is_an_isotropic_matrix_fisher_distribution() -> None:
    # scipy: Rotation.from_euler("ZXY", [10, 20, 30], degrees=True) against the bin at roll 0, azimuth 15, elevation 15
    head = small()
    angles = (torch.tensor([math.radians(30)]), torch.tensor([math.radians(20)]), torch.tensor([math.radians(10)]))
    log_kernel = head.log_kernel(*angles).view(12, 12, 6)
    torch.testing.assert_close(log_kernel.exp().sum(), torch.tensor(1.0))
    near, other = (0, 6, 3), (1, 6, 3)
    centres = [rotation_from_angles(*torch.tensor([15.0, 15.0, roll]).deg2rad()) for roll in (0.0, 30.0)]
    theta = [float(rotation_error(rotation_from_angles(*angles)[0], centre)) for centre in centres]
    expected = (math.cos(theta[0]) - math.cos(theta[1])) / head.sigma**2
    assert float(log_kernel[near] - log_kernel[other]) == pytest.approx(expected, rel=1e-4)


def test_the_divergence_is_zero_for_the_target_itself(monkeypatch) -> None:
    head, angles = small(), [torch.tensor([x]) for x in (0.4, 0.3, 0.2)]
    joint = head.log_kernel(*angles).view(1, 12, -1)

    def outputs(pictures):
        drawn = torch.multinomial(joint.logsumexp(2).exp(), 1, generator=None)
        del drawn
        return head_outputs

    torch.manual_seed(3)
    drawn = int(torch.multinomial(joint.logsumexp(2).exp(), 1))
    rolls = joint.logsumexp(2)
    view = joint[:, drawn].log_softmax(1)
    head_outputs = torch.cat([rolls, rolls.roll(-drawn, 1)]), torch.cat([view, view])
    monkeypatch.setattr(head, "_outputs", outputs)
    torch.manual_seed(3)
    torch.testing.assert_close(head.divergence(torch.ones(1, 3, 16, 16), *angles), torch.zeros(1), rtol=0, atol=1e-5)


@pytest.mark.parametrize("symmetry", ["none", "y"])
def test_learns_the_rotations_of_two_pictures_at_all_rolls(symmetry) -> None:
    head = small(symmetry)
    pictures = torch.ones(2, 3, 16, 16)
    pictures[0, 0, 3:8, 4:12], pictures[0, 1, 8:13, 4:9] = 0.0, 0.2  # two boxes each: what is up can be told
    pictures[1, 2, 4:12, 3:8], pictures[1, 1, 4:9, 8:13] = 0.0, 0.2
    azimuth, elevation, roll = torch.tensor([[0.3, -2.0], [0.5, -0.9], [0.0, 0.5]])
    views, angles = pictures.repeat(8, 1, 1, 1), (azimuth.repeat(8), elevation.repeat(8))
    adam = torch.optim.Adam(head.parameters(), 5e-3)
    for _ in range(80):
        turn = 2 * math.pi * torch.rand(16)
        rotated = warp(Rendering(views), turn, torch.zeros(16, 2), torch.ones(16)).image
        adam.zero_grad()
        head.divergence(rotated, *angles, roll.repeat(8) + turn).mean().backward()
        adam.step()
    found = rotation_of(PosePosterior(head.eval())({}, Observation(pictures), 1, [torch.Generator()] * 2))
    truth = rotation_from_angles(azimuth, elevation, roll).double()
    assert rotation_error(found, truth, symmetry).rad2deg().max() < 12


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"symmetry": "z"}, "RotationHead: symmetry must be one of none, y, y2"),
        ({"bin_deg": 0.5}, "RotationHead: bin_deg must lie between 5 and 90"),
        ({"bin_deg": 11.0}, "RotationHead: bin_deg must divide 180, got 11"),
        ({"sigma_deg": 0.0}, "RotationHead: sigma_deg must lie between"),
    ],
)
def test_refuses_bins_that_are_none(settings: dict, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        RotationHead(**settings)
