"""The short fit that judges a generator: it finds poses, and inside Lightning's test as well."""

import pytest
import torch
from lightning.pytorch import Trainer
from torch import nn
from torch.utils.data import DataLoader

from kfit.core import Angle, Encoder, Generator, Observation, Real, Rendering, Variable
from kfit.energies import L1
from kfit.generators import ExtentsHead
from kfit.geometry import rotation_error, rotation_from_angles
from kfit.training import ConditionalVAE
from kfit.training.short_fit import fitted_rotations

SIDE = 24
POINTS = torch.tensor([[0.8, 0.1, 0.0], [-0.2, 0.7, 0.3], [0.0, -0.3, 0.8]])


class ThreeSpots(Generator):
    """A red, a green and a blue spot, each dimmer the farther away it is."""

    def __init__(self, masks=True):
        super().__init__()
        angles = {name: Variable((), Angle()) for name in ("azimuth", "elevation")}
        self.variables = {"code": Variable((2,), Real()), **angles}
        self.masks, self.unused = masks, nn.Parameter(torch.zeros(()))

    def forward(self, code, azimuth, elevation):
        turn = rotation_from_angles(azimuth, elevation, torch.zeros_like(azimuth))
        x, y, z = torch.einsum("nij,kj->nki", turn, POINTS.to(turn)).unbind(-1)
        along = torch.linspace(-1, 1, SIDE).to(turn)
        apart = (along - x[..., None]).square()[:, :, None] + (-along - y[..., None]).square()[..., None]
        spots = (-8 * apart).exp() * (0.7 + 0.3 * z)[..., None, None]
        mask = spots.amax(1, keepdim=True) if self.masks else None
        return Rendering(1 - spots + 0 * self.unused + 0 * code.sum(), mask)


class Blank(Encoder):
    def __init__(self):
        super().__init__()
        self.unused = nn.Parameter(torch.zeros(()))

    def forward(self, image):
        mean = image.new_zeros(len(image), 2) + 0 * self.unused
        return mean, mean - 4


def views(count=6):
    rng = torch.Generator().manual_seed(0)
    azimuth = 6.28 * torch.rand(count, generator=rng)
    elevation = torch.rand(count, generator=rng)
    with torch.no_grad():
        drawn = ThreeSpots()(code=torch.zeros(count, 2), azimuth=azimuth, elevation=elevation)
    return drawn, azimuth, elevation


@pytest.mark.parametrize("masks", [True, False])
def test_it_finds_unknown_poses_under_autocast_and_inference_mode(masks):
    drawn, azimuth, elevation = views()
    with torch.inference_mode(), torch.autocast("cpu", torch.bfloat16):
        found = fitted_rotations(ThreeSpots(masks), Blank(), Observation(drawn.image, drawn.mask if masks else None))
    truth = rotation_from_angles(azimuth, elevation, torch.zeros_like(azimuth)).double()
    errors = rotation_error(found, truth).rad2deg()
    assert errors.shape == (6,)
    assert errors.quantile(0.5) < 5


@pytest.mark.slow
@pytest.mark.filterwarnings(
    "ignore:.*does not have many workers", r"ignore:`isinstance\(treespec, LeafSpec\)` is deprecated:FutureWarning"
)
def test_a_conditional_vae_is_tested_by_every_fifth_view_and_by_its_reconstruction(tmp_path, monkeypatch):
    fitted = []
    monkeypatch.setattr(
        "kfit.training.conditional_vae.fitted_rotations",
        lambda generator, encoder, observed: fitted.append(observed) or fitted_rotations(generator, encoder, observed),
    )
    drawn, azimuth, elevation = views(11)
    inputs = {
        "source": drawn.image, "target": drawn.image, "target_mask": drawn.mask, "azimuth": azimuth,
        "elevation": elevation,
    }  # fmt: skip
    module = ConditionalVAE(ThreeSpots(), Blank(), ExtentsHead(2, 4), {"image": L1()})
    silent = dict.fromkeys(("logger", "enable_progress_bar", "enable_model_summary", "enable_checkpointing"), False)
    trainer = Trainer(accelerator="cpu", precision="bf16-mixed", default_root_dir=tmp_path, **silent)
    (figures,) = trainer.test(module, DataLoader([inputs], batch_size=None), verbose=False)
    torch.testing.assert_close(fitted[0].image, drawn.image[[0, 5, 10]])
    assert set(figures) == {
        f"test/{name}" for name in ("image", "l1", "ssim", "mask_iou", "rotation_deg", "within_10deg", "within_30deg")
    }
    assert figures["test/l1"] < 0.01
    assert figures["test/ssim"] > 0.99
    assert figures["test/rotation_deg"] < 5
    assert figures["test/within_10deg"] > 0.5
    (validated,) = trainer.validate(module, DataLoader([inputs], batch_size=None), verbose=False)
    assert set(validated) == {f"val/{name}" for name in ("image", "l1", "ssim", "mask_iou")}
    assert len(fitted) == 1
