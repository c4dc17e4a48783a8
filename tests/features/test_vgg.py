import os
from pathlib import Path
from urllib.error import URLError

import pytest
import torch
from safetensors.torch import save_file
from skimage.data import astronaut, cat
from torch import nn

from kfit.features import VGG16, VGG19

# torchvision's configurations "D" and "E"
D = (64, 64, "M", 128, 128, "M", 256, 256, 256, "M", 512, 512, 512, "M", 512, 512, 512, "M")
E = (64, 64, "M", 128, 128, "M", 256, 256, 256, 256, "M", 512, 512, 512, 512, "M", 512, 512, 512, 512, "M")


def as_torchvision(configuration, num_modules):
    torch.manual_seed(0)
    modules, channels = [], 3
    for width in configuration:
        if width == "M":
            modules.append(nn.MaxPool2d(2, 2))
        else:
            modules += [nn.Conv2d(channels, width, 3, padding=1), nn.ReLU()]
            nn.init.kaiming_normal_(modules[-2].weight)
            channels = width
    return nn.Sequential(*modules[:num_modules])


def state_of(reference):
    return {f"features.{name}": tensor for name, tensor in reference.state_dict().items()}


@pytest.mark.parametrize(
    ("network", "configuration", "positions"),
    [
        (VGG16, D, {"relu1_1": 1, "conv1_2": 2, "pool1": 4, "relu2_2": 8, "conv3_3": 14, "relu3_3": 15}),
        (VGG19, E, {"conv1_1": 0, "relu2_1": 6, "conv3_3": 14, "relu3_4": 17, "pool3": 18, "relu4_1": 20}),
    ],
)
def test_layers_are_those_of_torchvisions_network(network, configuration, positions, tmp_path):
    reference = as_torchvision(configuration, max(positions.values()) + 1)
    torch.save(state_of(reference), tmp_path / "vgg.pth")
    image = torch.rand(2, 3, 32, 40)
    found = network(tuple(positions), str(tmp_path / "vgg.pth"))(image)
    x = (image - torch.tensor([0.485, 0.456, 0.406])[:, None, None]) / torch.tensor([0.229, 0.224, 0.225])[
        :, None, None
    ]
    assert set(found) == set(positions)
    with torch.no_grad():
        for name, position in positions.items():
            torch.testing.assert_close(found[name], reference[: position + 1](x), rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize(("network", "configuration", "last"), [(VGG16, D, "relu5_3"), (VGG19, E, "relu5_4")])
def test_names_reach_the_last_convolution(network, configuration, last, tmp_path):
    # one number spread over each shape makes a small file
    state = {k: torch.zeros(1).expand(v.shape) for k, v in state_of(as_torchvision(configuration, 99)).items()}
    torch.save(state, tmp_path / "vgg.pth")
    made = network((last,), str(tmp_path / "vgg.pth"))
    assert set(made.state_dict()) == set(state)
    assert made(torch.rand(1, 3, 32, 32))[last].shape == (1, 512, 2, 2)


def test_it_ends_at_the_last_layer_asked_for_and_reads_safetensors(tmp_path):
    save_file(state_of(as_torchvision(D, 4)), tmp_path / "vgg.safetensors")
    made = VGG16(["relu1_2"], str(tmp_path / "vgg.safetensors"))
    assert len(made.features) == 4
    assert not any(p.requires_grad for p in made.parameters())


def test_a_layer_that_does_not_exist_is_refused_with_those_that_do():
    with pytest.raises(ValueError, match=r"relu3_3.*relu3_4"):
        VGG16(("relu3_4",), "never read")
    with pytest.raises(ValueError, match="at least one"):
        VGG16((), "never read")


def test_a_file_that_is_missing_truncated_or_foreign_gets_one_sentence(tmp_path):
    with pytest.raises(FileNotFoundError, match="there is no file"):
        VGG16(weights=str(tmp_path / "none.pth"))
    whole = tmp_path / "whole.pth"
    torch.save({"features.0.weight": torch.zeros(8, 3, 3, 3)}, whole)
    with pytest.raises(ValueError, match=r"not torchvision's VGG16: features.0.weight must have shape \(64, 3, 3, 3\)"):
        VGG16(weights=str(whole))
    torch.save([1, 2], tmp_path / "list.pth")
    with pytest.raises(ValueError, match=r"not torchvision's VGG16.*missing"):
        VGG16(weights=str(tmp_path / "list.pth"))
    for name in ("cut.pth", "cut.safetensors", "empty.pth"):
        (tmp_path / name).write_bytes(whole.read_bytes()[: 0 if name.startswith("empty") else 200])
        with pytest.raises(ValueError, match="cannot be read"):
            VGG16(weights=str(tmp_path / name))


def test_without_a_file_torchvisions_is_fetched_and_reported(monkeypatch, tmp_path, caplog):
    asked = []

    def load(url, **settings):
        asked.append((url, settings["check_hash"], settings["weights_only"]))
        return state_of(as_torchvision(E, 2))

    monkeypatch.setattr(torch.hub, "get_dir", lambda: str(tmp_path))
    monkeypatch.setattr(torch.hub, "load_state_dict_from_url", load)
    VGG19(("relu1_1",))
    assert asked == [("https://download.pytorch.org/models/vgg19-dcbb9e9d.pth", True, True)]
    logged = caplog.text
    assert "548 MB" in logged
    assert asked[0][0] in logged
    assert str(tmp_path) in logged


def test_without_a_network_it_tells_how_to_pass_a_file(monkeypatch, tmp_path):
    def load(url, **settings):
        raise URLError("no route to host")

    monkeypatch.setattr(torch.hub, "get_dir", lambda: str(tmp_path))
    monkeypatch.setattr(torch.hub, "load_state_dict_from_url", load)
    with pytest.raises(RuntimeError, match=r"no route to host.*VGG16\(weights='vgg16-397923af.pth'\)"):
        VGG16()


@pytest.mark.skipif("KFIT_DEV_DATA" not in os.environ, reason="KFIT_DEV_DATA names no folder with weights/")
def test_the_real_vgg16_finds_a_dimmed_face_nearer_to_itself_than_to_a_cat():
    made = VGG16(weights=str(Path(os.environ["KFIT_DEV_DATA"]) / "weights" / "vgg16_features.safetensors"))
    face, other = (torch.from_numpy(p).permute(2, 0, 1)[None] / 255 for p in (astronaut(), cat()))
    pictures = (face[..., 40:168, 160:288], 0.8 * face[..., 41:169, 162:290], other[..., 60:188, 120:248])
    observed, moved, cats = (made(picture)["relu3_3"] for picture in pictures)
    assert observed.shape == (1, 256, 32, 32)
    assert 0 < (observed - moved).square().mean() < 0.5 * (observed - cats).square().mean()
