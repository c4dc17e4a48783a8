"""Released checkpoints: the same pictures, codes and warps as the released code's, from the same numbers.

``released_reference/reference.npz`` was computed with xuchen-ethz/neural_object_fitting@7309348 in evaluation mode
(align_corners=True, as PyTorch 1.1 did) on the weights of `released_weights`.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from released_weights import released_weights
from scipy.spatial.transform import Rotation
from torch import nn

from kfit.core import Rendering
from kfit.generators import SimilarityWarp
from kfit.generators.similarity_warp import warp
from kfit.geometry import rotation_from_angles, to_opencv
from kfit.models import load_released, released_values

HERE = Path(__file__).parent / "released_reference"


@pytest.fixture(scope="module")
def theirs():
    return released_weights()


@pytest.fixture(scope="module")
def networks(theirs, tmp_path_factory):
    path = tmp_path_factory.mktemp("released") / "model_latest.pth"
    torch.save(theirs, path)
    return load_released(path)


@pytest.fixture(scope="module")
def reference():
    return {name: torch.from_numpy(array) for name, array in np.load(HERE / "reference.npz").items()}


@pytest.fixture(scope="module")
def values(reference):
    elevation, azimuth, _ = reference["angles_deg"].unbind(1)
    similarity = (reference[f"warp_{name}"][:, 0] for name in ("angle", "tx", "ty", "scale"))
    return released_values(reference["z"], elevation, azimuth, *similarity)


def test_the_generator_draws_the_released_code_s_pictures(networks, reference, values):
    with torch.no_grad():
        drawn = networks[0](**{name: values[name] for name in ("code", "azimuth", "elevation")})
    assert drawn.mask is None
    torch.testing.assert_close(2 * drawn.image - 1, reference["generated"], rtol=0, atol=1e-4)


def test_the_encoder_gives_the_released_code_s_codes(networks, reference):
    with torch.no_grad():
        mean, log_variance = networks[1]((reference["encoder_input"] + 1) / 2)
    torch.testing.assert_close(torch.cat([mean, log_variance], 1), reference["encoded"], rtol=0, atol=1e-4)


def test_the_encoder_computes_what_torch_s_spectral_norm_does(tmp_path, theirs):
    # The reference values all lie at the ends of the tanh; here u and v are singular vectors, as after training.
    layers: list[nn.Module] = []
    for index, (a, b) in enumerate(((3, 64), (64, 128), (128, 256), (256, 512))):
        layers += [nn.utils.spectral_norm(nn.Conv2d(a, b, 3, 2, 1)), nn.LeakyReLU(0.2)]
        layers += [nn.InstanceNorm2d(b)] if index else []
    out = nn.Sequential(
        nn.utils.spectral_norm(nn.Linear(8192, 128)), nn.LeakyReLU(0.2), nn.utils.spectral_norm(nn.Linear(128, 32))
    )
    network = nn.ModuleDict({"model": nn.Sequential(*layers), "enc_out": out})
    image = torch.rand(2, 3, 64, 64)
    for _ in range(5):  # forward passes in training mode move u and v
        network["enc_out"](network["model"](2 * image - 1).flatten(1))
    network.eval()
    with torch.no_grad():
        expected = network["enc_out"](network["model"](2 * image - 1).flatten(1)).tanh()
    path = tmp_path / "model_latest.pth"
    torch.save({"netG": theirs["netG"], "netE": network.state_dict()}, path)
    with torch.no_grad():
        found = torch.cat(load_released(path)[1](image), 1)
    assert expected.abs().max() < 0.99
    assert expected.std() > 0.01
    torch.testing.assert_close(found, expected, rtol=0, atol=1e-4)


def test_the_warp_is_the_released_code_s(reference, values):
    image = Rendering((reference["encoder_input"] + 1) / 2)
    found = 2 * warp(image, values["roll"], values["shift"], values["scale"]).image - 1
    apart = (found - reference["warped"]).abs().amax(1)
    # Theirs is white as soon as it looks beyond the outer pixels' centres; kfit blends over the next pixel.
    inside = (reference["warped"] != 1).any(1)
    assert inside.float().mean() > 0.5
    assert float(apart[inside].max()) < 1e-4
    assert ((apart[~inside] > 1e-4).sum() / apart.numel()) < 0.02


def test_rotations_are_those_that_the_released_code_reports(reference, values):
    # Its eval.py, with half-turns ax, ay, az: Euler "yxz" of (−ay − ½, ax + 1, −az) · 180°.
    elevation, azimuth, _ = reference["angles_deg"].double().unbind(1)
    roll = reference["warp_angle"][:, 0].double().rad2deg()
    euler = torch.stack([-azimuth - 90, elevation + 180, -roll], 1)
    expected = Rotation.from_euler("yxz", euler.numpy(), degrees=True).as_matrix()
    found = rotation_from_angles(*(values[name].double() for name in ("azimuth", "elevation", "roll")))
    np.testing.assert_allclose(to_opencv(found), expected, atol=1e-6)


def test_their_numbers_are_values_of_a_similarity_warp_around_the_generator(networks, values):
    generator = SimilarityWarp(networks[0])
    assert list(generator.variables) == list(values)
    with torch.no_grad():
        drawn = generator(**values)
    assert drawn.image.shape == (4, 3, 64, 64)


def save(tmp_path, saved):
    path = tmp_path / "other.pth"
    torch.save(saved, path)
    return path


def test_another_file_gets_one_sentence_that_says_what_is_wrong(tmp_path, theirs):
    with pytest.raises(FileNotFoundError, match="no checkpoint at"):
        load_released(tmp_path / "nothing.pth")
    (tmp_path / "text.pth").write_text("no checkpoint")
    lacking = {name: tensor for name, tensor in theirs["netG"].items() if name != "mlp2.fc.bias"}
    other = theirs["netE"] | {"model.5.bias": torch.zeros(3)}
    for path, sentence in [
        (tmp_path / "text.pth", "is no released checkpoint"),
        (save(tmp_path, {"state_dict": {}}), "is no released checkpoint.*netG"),
    ]:
        with pytest.raises(ValueError, match=sentence):
            load_released(path)
    for saved, sentence in [
        ({"netG": lacking, "netE": theirs["netE"]}, r"it lacks 'mlp2\.fc\.bias'"),
        ({"netG": theirs["netG"], "netE": other}, r"its shapes are others: .*features\.5\.bias"),
        ({"netG": [], "netE": {}}, "is no released checkpoint"),
    ]:
        with pytest.raises(ValueError, match=sentence) as raised:
            load_released(save(tmp_path, saved))
        assert "\n" not in str(raised.value)


def test_a_checkpoint_that_would_run_code_is_refused(tmp_path):
    with pytest.raises(ValueError, match="is no released checkpoint"):
        load_released(save(tmp_path, {"netG": print, "netE": {}}))


def test_numbers_of_other_shapes_are_refused_by_name():
    row = torch.zeros(2)
    with pytest.raises(ValueError, match=r"angle must have shape \(2,\), got \(2, 1\)"):
        released_values(torch.zeros(2, 16), row, row, row[:, None], row, row, row)
