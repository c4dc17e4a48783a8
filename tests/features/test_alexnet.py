from urllib.error import URLError

import pytest
import torch
from safetensors.torch import save_file
from torch import nn

from kfit.features import AlexNet


def as_torchvision():
    """The convolutional part of ``torchvision.models.alexnet`` with random weights."""
    torch.manual_seed(0)
    return nn.Sequential(
        nn.Conv2d(3, 64, 11, 4, 2), nn.ReLU(), nn.MaxPool2d(3, 2),
        nn.Conv2d(64, 192, 5, padding=2), nn.ReLU(), nn.MaxPool2d(3, 2),
        nn.Conv2d(192, 384, 3, padding=1), nn.ReLU(),
        nn.Conv2d(384, 256, 3, padding=1), nn.ReLU(),
        nn.Conv2d(256, 256, 3, padding=1), nn.ReLU(), nn.MaxPool2d(3, 2),
    )  # fmt: skip


@pytest.fixture(scope="module")
def weights(tmp_path_factory):
    file = tmp_path_factory.mktemp("weights") / "alexnet.safetensors"
    save_file({f"features.{name}": tensor for name, tensor in as_torchvision().state_dict().items()}, file)
    return str(file)


def test_layers_are_those_of_torchvisions_network(weights):
    positions = {"conv1": 0, "relu1": 1, "pool1": 2, "relu2": 4, "conv3": 6, "relu3": 7, "relu4": 9, "relu5": 11}
    positions["pool5"] = 12
    image = torch.rand(2, 3, 64, 80)
    found = AlexNet(tuple(positions), weights)(image)
    x = (image - torch.tensor([0.485, 0.456, 0.406])[:, None, None]) / torch.tensor([0.229, 0.224, 0.225])[
        :, None, None
    ]
    assert set(found) == set(positions)
    with torch.no_grad():
        for index, module in enumerate(as_torchvision()):
            x = module(x)
            for name in (name for name, position in positions.items() if position == index):
                torch.testing.assert_close(found[name], x, rtol=1e-4, atol=1e-5)


def test_it_ends_at_the_last_layer_asked_for_and_names_parameters_as_torchvision(weights):
    made = AlexNet(["relu2"], weights)
    assert set(made.state_dict()) == {f"features.{n}.{kind}" for n in (0, 3) for kind in ("weight", "bias")}
    assert not any(p.requires_grad for p in made.parameters())
    assert AlexNet(["relu5"], weights)(torch.rand(1, 3, 64, 64))["relu5"].shape == (1, 256, 3, 3)


@pytest.mark.parametrize(("layer", "least"), [("relu1", 7), ("relu2", 15), ("relu5", 31), ("pool5", 63)])
def test_a_picture_that_is_too_small_for_a_layer_is_refused_with_the_least_size(weights, layer, least):
    made = AlexNet([layer], weights)
    assert min(made(torch.rand(1, 3, least, least))[layer].shape) > 0
    with pytest.raises(ValueError, match=f"image must be at least {least} pixels high and wide, got"):
        made(torch.rand(1, 3, least, least - 1))


def test_a_layer_that_does_not_exist_is_refused_with_those_that_do():
    with pytest.raises(ValueError, match=r"relu5.*relu6"):
        AlexNet(("relu6",), "never read")
    with pytest.raises(ValueError, match="at least one"):
        AlexNet((), "never read")


def test_without_a_file_torchvisions_is_fetched_and_reported(monkeypatch, tmp_path, caplog):
    def load(url, **settings):
        assert url == "https://download.pytorch.org/models/alexnet-owt-7be5be79.pth"
        assert settings["check_hash"]
        assert settings["weights_only"]
        return {f"features.{name}": tensor for name, tensor in as_torchvision().state_dict().items()}

    monkeypatch.setattr(torch.hub, "get_dir", lambda: str(tmp_path))
    monkeypatch.setattr(torch.hub, "load_state_dict_from_url", load)
    AlexNet()
    assert "fetching AlexNet's weights (233 MB)" in caplog.text


def test_without_a_network_it_tells_how_to_pass_a_file(monkeypatch, tmp_path):
    def load(url, **settings):
        raise URLError("no route to host")

    monkeypatch.setattr(torch.hub, "get_dir", lambda: str(tmp_path))
    monkeypatch.setattr(torch.hub, "load_state_dict_from_url", load)
    with pytest.raises(RuntimeError, match=r"no route to host.*AlexNet\(weights='alexnet-owt-7be5be79.pth'\)"):
        AlexNet()
