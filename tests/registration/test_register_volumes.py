"""Registration of volumes in one call."""

import pytest
import torch
import torch.nn.functional as F
from kornia.geometry.linalg import transform_points
from kornia.geometry.transform import get_affine_matrix3d, warp_affine3d

import kfit
from kfit.energies import MSSSIM, NCC, MutualInformation

SIZE = (24, 26, 28)


def volume(seed=0):
    coarse = torch.rand(1, 1, 6, 6, 6, generator=torch.Generator().manual_seed(seed))
    return F.interpolate(coarse, SIZE, mode="trilinear", align_corners=True)


def moved(angles=(0.0, 0.0, 0.0), shift=(0.0, 0.0, 0.0), scale=1.0, shear=0.0):
    """The volume moved by Kornia's matrix and warp, where that shows it, and the matrix."""
    centre = torch.tensor([[(side - 1) / 2 for side in SIZE[::-1]]])
    matrix = get_affine_matrix3d(
        torch.tensor([shift]),
        centre,
        torch.full((1, 3), scale),
        torch.tensor([angles]),
        sxy=torch.tensor([shear]) if shear else None,
    )
    both = torch.cat([volume(), torch.ones(1, 1, *SIZE)], 1)
    fixed, cover = warp_affine3d(both, matrix[:, :3], SIZE).split(1, 1)
    return fixed, (cover > 0.999).float(), matrix


def corner_error(found, truth):
    ends = torch.tensor([side - 1.0 for side in SIZE[::-1]])
    corners = torch.cartesian_prod(*[torch.tensor([0.0, 1.0])] * 3)[None] * ends
    return float((transform_points(found, corners) - transform_points(truth, corners)).norm(dim=2).mean())


@pytest.mark.parametrize(
    ("motion", "truth"),
    [
        ("translation", {"shift": (3.4, -2.2, 1.6)}),
        ("euclidean", {"angles": (8.0, -12.0, 15.0), "shift": (2.0, -1.5, 1.0)}),
        pytest.param(
            "similarity",
            {"angles": (-6.0, 9.0, 4.0), "shift": (1.0, 2.0, -1.0), "scale": 1.1},
            marks=pytest.mark.slow,
        ),
        pytest.param(
            "affine",
            {"angles": (5.0, 6.0, -7.0), "shift": (1.0, -1.0, 0.5), "scale": 0.95, "shear": 0.08},
            marks=pytest.mark.slow,
        ),
    ],
)
def test_a_volume_that_kornia_moved_is_found(motion, truth):
    fixed, mask, matrix = moved(**truth)
    found = kfit.register(volume(), fixed, motion, fixed_mask=mask)
    assert corner_error(torch.eye(4)[None], matrix) > 2
    assert corner_error(found.matrix, matrix) < 0.2
    assert float(found.overlap) > 0.9
    assert found.warped.shape == (1, 1, *SIZE)


def test_points_and_other_volumes_go_the_same_way():
    fixed, mask, matrix = moved(angles=(0.0, 0.0, 10.0), shift=(2.0, 0.0, -1.0))
    found = kfit.register(volume(), fixed, "euclidean", fixed_mask=mask, light=False)
    points = torch.tensor([[[20.0, 14.0, 10.0], [12.0, 18.0, 15.0]]])
    torch.testing.assert_close(
        found.transform_points(points), transform_points(torch.linalg.inv(matrix), points), rtol=0, atol=0.1
    )
    inside = found.weight > 0.999
    assert float((found.warp(volume()) - found.warped)[inside].abs().max()) < 1e-3
    assert float((found.warped - fixed)[inside & (mask > 0)].abs().mean()) < 0.01


def test_gain_and_offset_of_a_volume_are_found_too():
    fixed, mask, matrix = moved(shift=(2.0, 1.0, -1.0))
    found = kfit.register(volume(), 0.6 * fixed + 0.3, "translation", fixed_mask=mask)
    assert corner_error(found.matrix, matrix) < 0.1
    assert float(found.gain) == pytest.approx(0.6, abs=0.03)
    assert float(found.offset) == pytest.approx(0.3, abs=0.03)


@pytest.mark.parametrize("energy", [NCC(), MutualInformation()], ids=["NCC", "MutualInformation"])
def test_other_energies_and_a_start_serve_volumes(energy):
    fixed, mask, matrix = moved(angles=(0.0, 10.0, 0.0), shift=(1.0, 0.0, 0.0))
    near = matrix.clone()
    near[:, :3, 3] += 1
    found = kfit.register(volume(), fixed.square(), "euclidean", energy=energy, fixed_mask=mask, initial=near)
    assert corner_error(found.matrix, matrix) < 0.5


@pytest.mark.slow
def test_a_batch_of_volumes_is_as_its_pairs_alone():
    fixed, mask, _ = moved(angles=(0.0, 8.0, 0.0))
    moving = torch.cat([volume(), volume(3)])
    fixed = torch.cat([fixed, volume(3).roll(3, 3)])
    mask = torch.cat([mask, torch.ones_like(mask)])
    mask[1, :, :, :3] = 0
    together = kfit.register(moving, fixed, "euclidean", fixed_mask=mask)
    for row in range(2):
        rows = slice(row, row + 1)
        alone = kfit.register(moving[rows], fixed[rows], "euclidean", fixed_mask=mask[rows])
        torch.testing.assert_close(together.matrix[rows], alone.matrix, rtol=0, atol=5e-3)
    torch.testing.assert_close(together.matrix[1, :3, 3], torch.tensor([0.0, 3.0, 0.0]), rtol=0, atol=0.1)


def test_volumes_of_other_sizes_are_registered_in_voxels():
    moving = volume()
    found = kfit.register(moving, moving[:, :, 2:, 3:-2, 1:-3], "translation")
    assert found.warped.shape[2:] == SIZE
    torch.testing.assert_close(found.matrix[0, :3, 3], torch.tensor([-1.0, -3.0, -2.0]), rtol=0, atol=0.1)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"motion": "homography"}, ValueError, "motion of volumes must be one of translation, euclidean, similarity"),
        ({"energy": MSSSIM()}, ValueError, "energy must compare volumes, which MSSSIM does not"),
        ({"fixed": torch.zeros(1, 1, 12, 12)}, ValueError, r"fixed must have shape \(B, C, D, H, W\)"),
        ({"fixed": torch.zeros(1, 1, 12, 4, 12)}, ValueError, "fixed must hold volumes of at least 8 × 8 × 8 voxels"),
        ({"initial": torch.eye(3)[None]}, ValueError, r"initial must have shape \(1, 4, 4\)"),
        ({"moving_mask": torch.ones(1, 1, 12, 12)}, ValueError, r"moving_mask must have shape \(1, 1, 12, 12, 12\)"),
    ],
)
def test_volumes_that_cannot_be_registered_are_refused(arguments, error, message):
    inputs = {"moving": torch.rand(1, 1, 12, 12, 12), "fixed": torch.rand(1, 1, 12, 12, 12), "motion": "affine"}
    with pytest.raises(error, match=message):
        kfit.register(**inputs | arguments)
