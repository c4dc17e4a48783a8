"""The paper's baseline without depth: VGG16 from a picture to a rotation."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from kfit.core.arguments import check_arguments
from kfit.core.check import check_shape
from kfit.features import VGG16
from kfit.geometry import Symmetry, check_symmetry, num_turns, turns_about_y
from kfit.runtime.old_weights import read_old_weights

# Width and number of the convolutions before each pooling: configuration D of Simonyan and Zisserman, table 1.
BLOCKS = ((64, 2), (128, 2), (256, 3), (512, 3), (512, 3))
# ImageNet's mean and spread, which published weights expect.
MEAN, STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)


class OrientationRegressor(nn.Module):
    """Predict one rotation from a picture (the VGG16 baseline of Chen et al. 2020, section 4.1).

    VGG16's thirteen convolutions and five poolings (Simonyan and Zisserman 2015), two hidden linear layers, and six
    numbers (a, b) that represent a rotation continuously (Zhou et al. 2019, "On the Continuity of Rotation
    Representations"): y = a / ‖a‖, z = (b − (b·y) y) / ‖·‖, x = y × z, R = (x y z). Unlike the published network each
    convolution is followed by batch normalisation, so that it can learn from random weights. 17.8 M parameters, 1.3 G
    multiply-adds a picture of 64 × 64.

    Args:
        symmetry: symmetry of the category, see `kfit.geometry.CATEGORIES`; with ``"y"`` the rotation about y is free,
            and only the direction of the y axis is learned.
        hidden_dim: number of features of the linear layers.
        image_size: side of the input pictures, a multiple of 32.

    Raises:
        ValueError: if the symmetry is unknown, or the picture size is not a multiple of 32.
    """

    mean: Tensor
    std: Tensor

    def __init__(self, symmetry: Symmetry = "none", hidden_dim: int = 1024, image_size: int = 64) -> None:
        super().__init__()
        check_arguments(OrientationRegressor, locals(), symmetry=(check_symmetry,), image_size=(32,))
        if image_size % 32:
            raise ValueError(f"OrientationRegressor: image_size must be a multiple of 32, got {image_size}")
        self.symmetry, self.image_size = symmetry, image_size
        self.register_buffer("mean", torch.tensor(MEAN).view(1, 3, 1, 1), persistent=False)
        self.register_buffer("std", torch.tensor(STD).view(1, 3, 1, 1), persistent=False)
        self.features = nn.Sequential()
        channels = 3
        for width, count in BLOCKS:
            for _ in range(count):
                self.features.extend([nn.Conv2d(channels, width, 3, padding=1), nn.BatchNorm2d(width), nn.ReLU(True)])
                channels = width
            self.features.append(nn.MaxPool2d(2))
        size = channels * (image_size // 32) ** 2
        self.output = nn.Sequential(
            nn.Linear(size, hidden_dim), nn.ReLU(True), nn.Linear(hidden_dim, hidden_dim), nn.ReLU(True),
            nn.Linear(hidden_dim, 6),
        )  # fmt: skip
        read_old_weights(self)
        # This layout makes convolutions 2 × as fast on a CPU.
        self.to(memory_format=torch.channels_last)  # type: ignore[call-overload]

    def fill(self, weights: str) -> None:
        """Load VGG16's ImageNet weights into the convolutions.

        Args:
            weights: path of a .pth or .safetensors file with torchvision's names, as `kfit.features.VGG16` reads it.

        Raises:
            ValueError: if the file is truncated or holds another network.
            FileNotFoundError: if there is no such file.
        """
        published = VGG16(("pool5",), weights).features
        pairs = zip(_convolutions(self.features), _convolutions(published), strict=True)
        for own, values in pairs:
            own.load_state_dict(values.state_dict())

    def forward(self, image: Tensor) -> Tensor:
        """Rotation (N, 3, 3) of the object in the generator's y-up frame, as `kfit.geometry.rotation_from_angles` has
        it, of pictures (N, 3, S, S) in [0, 1] on white.

        Raises:
            ValueError: if the pictures have another size.
        """
        check_shape("image", image, ("N", 3, self.image_size, self.image_size))
        output = self.output(self.features((image - self.mean) / self.std).flatten(1))
        # Out of autocast's halves, which are good to a quarter of a degree.
        up, forth = output.to(torch.promote_types(output.dtype, torch.float32)).chunk(2, 1)
        y = F.normalize(up, dim=1)
        z = F.normalize(forth - (forth * y).sum(1, keepdim=True) * y, dim=1)
        return torch.stack([torch.linalg.cross(y, z), y, z], 2)

    def distance(self, rotation: Tensor, truth: Tensor) -> Tensor:
        """Return the distance of rotations (N, 3, 3) from the true ones: 1 − cos θ (N,), in [0, 2].

        θ is `kfit.geometry.rotation_error` by the symmetry. It is ‖R − R*‖² / 4, the squared chordal distance, and with
        symmetry ‖y − y*‖² / 2. Unlike θ it is smooth at 0, and unlike θ² at π too.
        """
        if self.symmetry == "y":
            return (rotation[..., 1] - truth[..., 1]).square().sum(-1) / 2
        turns = turns_about_y(num_turns(self.symmetry)).to(truth)
        return torch.stack([(rotation - truth @ turn).square().sum((-2, -1)) / 4 for turn in turns]).amin(0)


def _convolutions(network: nn.Sequential) -> list[nn.Conv2d]:
    return [module for module in network if isinstance(module, nn.Conv2d)]
