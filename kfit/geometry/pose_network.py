"""The contract of networks that predict rotations, and the bins of rotations that they share."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import replace

import torch
from torch import Tensor, nn
from torch.nn.functional import log_softmax

from kfit.core import Observation, frozen
from kfit.geometry.pose import rotation_from_angles
from kfit.geometry.symmetry import Symmetry, num_turns, turns_about_y


class PoseNetwork(nn.Module, ABC):
    """Predicts a distribution over the rotations of the object in a picture.

    The rotations are bins: a grid of rolls × azimuths × elevations, R · A · E = B bins in this order, roll first.

    Args:
        rolls, azimuths, elevations: (R,), (A,) and (E,) centres of the bins in radians, increasing in even steps. R is
            1 if the network does not predict roll, A is 1 if the object has the symmetry ``"y"``; with ``"y2"`` to
            ``"y12"`` azimuths span that part of a circle.
        symmetry: symmetry of the objects.
        sigma: standard deviation in radians of the training targets around the true rotation.

    Example:
        >>> import torch
        >>> from kfit.generators import RotationHead
        >>> head = RotationHead(bin_deg=30, channels=(4, 4), hidden_dim=8).eval()
        >>> log_probability = head(torch.rand(1, 3, 64, 64))
        >>> log_probability.shape, head.rotations.shape  # 12 rolls × 12 azimuths × 6 elevations
        (torch.Size([1, 864]), torch.Size([864, 3, 3]))
    """

    rotations: Tensor
    log_volume: Tensor

    def __init__(self, rolls: Tensor, azimuths: Tensor, elevations: Tensor, symmetry: Symmetry, sigma: float) -> None:
        super().__init__()
        self.symmetry, self.sigma = symmetry, sigma
        self.num_rolls, self.num_azimuths, self.num_elevations = len(rolls), len(azimuths), len(elevations)
        roll, azimuth, elevation = torch.meshgrid(
            *(bins.double() for bins in (rolls, azimuths, elevations)), indexing="ij"
        )
        rotations = rotation_from_angles(azimuth, elevation, roll).flatten(0, 2)
        step = math.pi / 2 if len(elevations) == 1 else float(elevations[1] - elevations[0])
        low, high = (elevation.flatten() - step / 2).sin(), (elevation.flatten() + step / 2).sin()
        self.register_buffer("rotations", rotations.float(), persistent=False)
        self.register_buffer("log_volume", log_softmax((high - low).log(), 0).float(), persistent=False)

    @property
    def predicts_roll(self) -> bool:
        """Whether the bins differ in roll."""
        return self.num_rolls > 1

    @abstractmethod
    def forward(self, image: Tensor) -> Tensor:
        """Return log-probabilities (N, B) of the bins, from RGB (N, 3, S, S) in [0, 1] on white."""

    @property
    def prediction_name(self) -> str:
        """Name of its output in an observation's predictions; that of `kfit.core.frozen` twins is the same.

        Networks are identified by where their weights are in memory, which twins share.
        """
        return f"log-probabilities by {self.rotations.data_ptr():#x}"

    def log_probabilities(self, observation: Observation) -> Tensor:
        """Log-probabilities (B, bins) of B problems by their first views: those predicted before, else by `forward`."""
        known = observation.predictions.get(self.prediction_name)
        if known is not None:
            return known
        found: Tensor = self(observation.first_views().image)
        return found

    def log_kernel(self, azimuth: Tensor, elevation: Tensor, roll: Tensor) -> Tensor:
        """Return the log-probabilities (N, B) of a distribution around N rotations: the target of training.

        It is the isotropic matrix Fisher distribution (Khatri and Mardia 1977) over the bins,
        q_b ∝ v_b · exp(−(3 − tr(R_bᵀ R)) / 2σ²), where v_b is the bin's volume: near R, 3 − tr is the squared angle.
        With the symmetry ``"y"`` the angle is that between the vertical axes u: q_b ∝ v_b · exp(−(1 − u_b · u) / σ²);
        with ``"y2"`` to ``"y12"`` it is the least to the bin turned about its vertical axis.

        Args:
            azimuth, elevation, roll: (N,) in radians; roll is ignored where the network does not predict it.
        """
        rotation = rotation_from_angles(azimuth, elevation, roll if self.predicts_roll else torch.zeros_like(roll))
        squared = 2 * self.one_minus_cosine(rotation.to(self.rotations.dtype))
        return log_softmax(self.log_volume - squared / (2 * self.sigma**2), 1)

    def one_minus_cosine(self, rotation: Tensor) -> Tensor:
        """Return 1 − cos θ (N, B) for the angles θ between rotations (N, 3, 3) and the bins' centres."""
        # Half precision, under autocast, is too coarse for a cosine.
        with torch.autocast(rotation.device.type, enabled=False):
            if self.symmetry == "y":
                return 1 - rotation[:, :, 1] @ self.rotations[:, :, 1].mT
            return torch.stack(
                [(3 - rotation.flatten(1) @ bins.flatten(1).mT) / 2 for bins in self.equivalent_rotations()]
            ).amin(0)

    def equivalent_rotations(self) -> list[Tensor]:
        """The bins' rotations (B, 3, 3), turned about the vertical axis by each turn that leaves the object unchanged.

        Where all turns do, it is the bins as they are.
        """
        turns = turns_about_y(num_turns(self.symmetry) or 1).to(self.rotations)
        return [self.rotations @ turn for turn in turns[1:]] + [self.rotations]


def with_prediction(observation: Observation, network: PoseNetwork) -> Observation:
    """The observation with the network's log-probabilities among its predictions.

    Args:
        observation: B problems, on any device.
        network: is left as it is, in whatever mode.
    """
    device = network.rotations.device
    with torch.inference_mode(False), torch.no_grad(), torch.autocast(device.type, enabled=False):
        found = frozen(network).log_probabilities(observation.map(lambda tensor: tensor.to(device)))
    known = {network.prediction_name: found.to(observation.image.device)}
    return replace(observation, predictions={**observation.predictions, **known})
