import torch
from torch import nn

from kfit.features import EfficientNetLite0, FeatureNetwork


class One(FeatureNetwork):
    def __init__(self):
        super().__init__()
        self.norm = nn.Sequential(nn.Conv2d(3, 4, 1), nn.BatchNorm2d(4), nn.Dropout())
        self.freeze()

    def forward(self, image):
        return {"norm": self.norm(self.normalized(image))}


def test_a_feature_network_never_leaves_evaluation_nor_asks_for_gradients():
    network = One()
    outer = nn.Sequential(network).train()
    assert outer.training
    assert not any(module.training for module in network.modules())
    assert not any(p.requires_grad for p in network.parameters())


def test_building_one_from_weights_leaves_the_random_numbers_of_others_alone():
    before = torch.get_rng_state()
    EfficientNetLite0()
    assert torch.equal(torch.get_rng_state(), before)


def test_pictures_are_normalised_by_imagenets_statistics():
    image = torch.tensor([0.485, 0.456 + 0.224, 0.406]).view(1, 3, 1, 1)
    torch.testing.assert_close(One().normalized(image).flatten(), torch.tensor([0.0, 1.0, 0.0]))


def test_what_normalises_moves_with_the_network_and_is_not_saved():
    network = One().double()
    assert network.mean.dtype == torch.float64
    assert not {"mean", "std"} & set(network.state_dict())
