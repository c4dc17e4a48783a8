import importlib.util
import os
from pathlib import Path

import jsonargparse
import pytest
import torch
import torchmetrics.functional.image.lpips as theirs
from skimage.data import astronaut, cat
from torch import nn

from kfit.core import Energy
from kfit.energies import LPIPS

# torchvision's ``features``: channels out, kernel, stride and padding of each convolution; "M" pools
ALEX = ((64, 11, 4, 2), "M", (192, 5, 1, 2), "M", (384, 3, 1, 1), (256, 3, 1, 1), (256, 3, 1, 1), "M")
VGG = tuple(
    "M" if width == "M" else (width, 3, 1, 1)
    for width in (64, 64, "M", 128, 128, "M", 256, 256, 256, "M", 512, 512, 512, "M", 512, 512, 512, "M")
)
BACKBONES = {"alex": (ALEX, 3), "vgg": (VGG, 2)}


@pytest.fixture(scope="module")
def torchvisions(tmp_path_factory):
    """Backbones of torchvision's shape with random weights, and their files."""
    built = {}
    for name, (configuration, pool) in BACKBONES.items():
        torch.manual_seed(0)
        modules, channels = [], 3
        for convolution in configuration:
            if convolution == "M":
                modules.append(nn.MaxPool2d(pool, 2))
            else:
                modules += [nn.Conv2d(channels, *convolution), nn.ReLU()]
                nn.init.kaiming_normal_(modules[-2].weight)
                channels = convolution[0]
        features = nn.Sequential(*modules)
        file = tmp_path_factory.mktemp("weights") / f"{name}.pth"
        torch.save({f"features.{key}": tensor for key, tensor in features.state_dict().items()}, file)
        built[name] = (features, str(file))
    return built


def pictures(size=64, rows=2):
    rng = torch.Generator().manual_seed(1)
    return [torch.rand(rows, 3, size, size, generator=rng) for _ in range(2)]


EACH_BACKBONE = pytest.mark.parametrize("backbone", ["alex", pytest.param("vgg", marks=pytest.mark.slow)])


@EACH_BACKBONE
def test_it_is_what_torchmetrics_computes_on_the_same_backbone(backbone, torchvisions, monkeypatch):
    features, file = torchvisions[backbone]
    monkeypatch.setattr(theirs, "_get_tv_model_features", lambda net, pretrained: features)
    reference = theirs._LPIPS(net=backbone)
    energy = LPIPS(backbone, file)
    for size in (64, 45):
        x, y = pictures(size)
        expected = reference(x, y, normalize=True).flatten()
        torch.testing.assert_close(energy(x, y), expected, rtol=1e-4, atol=1e-6)
        assert energy(y, y).tolist() == [0, 0]


def test_by_hand_it_is_the_mean_over_pixels_of_weighted_squares_of_unit_features(torchvisions):
    energy = LPIPS("alex", torchvisions["alex"][1])
    x, y = pictures()
    package = Path(importlib.util.find_spec("torchmetrics").origin).parent
    heads = torch.load(package / "functional/image/lpips_models/alex.pth", map_location="cpu", weights_only=True)
    # the paper's scaling, for pictures in [-1, 1]
    shift, scale = (torch.tensor(c).view(3, 1, 1) for c in ([-0.030, -0.088, -0.188], [0.458, 0.448, 0.450]))
    shown, second = ((2 * picture - 1 - shift) / scale for picture in (x, y))
    expected, layer = 0, 0
    for module in torchvisions["alex"][0]:
        shown, second = module(shown), module(second)
        if isinstance(module, nn.ReLU):
            difference = nn.functional.normalize(shown, eps=1e-10) - nn.functional.normalize(second, eps=1e-10)
            head = heads[f"lin{layer}.model.1.weight"]
            expected, layer = expected + (head * difference.square()).sum(1).mean((1, 2)), layer + 1
    torch.testing.assert_close(energy(x, y), expected.detach(), rtol=1e-4, atol=1e-6)


def test_the_target_goes_through_the_backbone_once(torchvisions, monkeypatch):
    energy, (x, y) = LPIPS("alex", torchvisions["alex"][1]), pictures()
    calls, forward = [], type(energy.network).forward
    monkeypatch.setattr(type(energy.network), "forward", lambda net, image: calls.append(1) or forward(net, image))
    prepared = energy.prepare(y)
    for _ in range(3):
        energy.compare(x, prepared)
    assert len(calls) == 4


def test_nothing_of_it_trains_and_gradients_reach_the_picture(torchvisions):
    energy, (x, y) = LPIPS("alex", torchvisions["alex"][1]).train(), pictures()
    assert not energy.network.training
    assert not any(p.requires_grad for p in energy.parameters())
    gradient = torch.autograd.grad(energy(x.requires_grad_(), y).sum(), x)[0]
    assert gradient.abs().sum() > 0


def test_a_half_hidden_object_has_its_least_energy_at_the_truth(torchvisions):
    energy, (_, truth) = LPIPS("alex", torchvisions["alex"][1]), pictures()
    weight = torch.ones(2, 1, 64, 64)
    weight[..., 40:] = 0
    observed = torch.where(weight > 0, truth, 0.2)
    assert energy(truth, observed, weight).max() < 1e-8
    assert energy(truth, observed).min() > 1e-4


def test_a_recipe_names_its_backbone(torchvisions):
    parser = jsonargparse.ArgumentParser()
    parser.add_argument("--energies", type=dict[str, Energy])
    recipe = (
        f"energies: {{image: {{class_path: kfit.energies.LPIPS, init_args: {{weights: {torchvisions['alex'][1]}}}}}}}"
    )
    energies = parser.instantiate(parser.parse_string(recipe)).energies
    assert isinstance(energies["image"], LPIPS)


def test_another_backbone_a_small_picture_and_missing_heads_are_refused(torchvisions, monkeypatch):
    with pytest.raises(ValueError, match="backbone must be 'alex' or 'vgg', got 'squeeze'"):
        LPIPS("squeeze")
    with pytest.raises(ValueError, match=r"image must be at least 31 pixels high and wide, got 30×64"):
        LPIPS("alex", torchvisions["alex"][1]).prepare(torch.rand(1, 3, 30, 64))
    monkeypatch.setattr("kfit.energies.lpips.find_spec", lambda name: None)
    with pytest.raises(ImportError, match="pip install torchmetrics"):
        LPIPS("alex", torchvisions["alex"][1])


@pytest.mark.skipif("KFIT_DEV_DATA" not in os.environ, reason="KFIT_DEV_DATA names no folder with weights/")
def test_on_the_real_vgg16_a_face_moved_and_dimmed_is_nearer_than_a_cat():
    energy = LPIPS("vgg", str(Path(os.environ["KFIT_DEV_DATA"]) / "weights" / "vgg16_features.safetensors"))
    face, other = (torch.from_numpy(p).permute(2, 0, 1)[None] / 255 for p in (astronaut(), cat()))
    observed, moved, cats = face[..., 40:104, 180:244], 0.9 * face[..., 41:105, 181:245], other[..., 60:124, 120:184]
    assert 0.02 < energy(moved, observed).item() < 0.5 * energy(cats, observed).item()


@pytest.mark.skipif("KFIT_DEV_DATA" not in os.environ, reason="KFIT_DEV_DATA names no folder with weights/")
def test_on_the_real_vgg16_it_is_the_value_in_torchmetrics_documentation():
    # LearnedPerceptualImagePatchSimilarity(net_type='vgg') of torchmetrics at 0062801: seed 123, then the network,
    # whose first weights take their random numbers before the pictures do, and tensor(0.3493) of the pictures
    energy = LPIPS("vgg", str(Path(os.environ["KFIT_DEV_DATA"]) / "weights" / "vgg16_features.safetensors"))
    torch.manual_seed(123)
    channels = 3
    for convolution in VGG:
        if convolution != "M":
            nn.Conv2d(channels, *convolution)
            channels = convolution[0]
    for inputs, outputs in ((25088, 4096), (4096, 4096), (4096, 1000)):
        nn.Linear(inputs, outputs)
    for width in (64, 128, 256, 512, 512):
        nn.Conv2d(width, 1, 1, bias=False)
    x, y = (torch.rand(10, 3, 100, 100) for _ in range(2))
    assert energy(x, y).mean().item() == pytest.approx(0.3493, abs=1e-4)


@EACH_BACKBONE
def test_pictures_in_double_precision_and_small_ones_get_an_answer_or_a_sentence(backbone, torchvisions):
    energy = LPIPS(backbone, torchvisions[backbone][1])
    x, y = pictures()
    torch.testing.assert_close(energy(x.double(), y.double()), energy(x, y), check_dtype=False)
    least = {"alex": 31, "vgg": 16}[backbone]
    assert energy(*pictures(least)).isfinite().all()
    with pytest.raises(ValueError, match=f"image must be at least {least} pixels high and wide, got 8×8"):
        energy(*pictures(8))
