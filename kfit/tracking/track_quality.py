"""Whether a tracked pose can be trusted, by its energy, its overlap with the mask, and how far it jumped."""

from __future__ import annotations

from dataclasses import dataclass, replace

from torch import Tensor

from kfit.geometry import Symmetry, rotation_error
from kfit.pose.confidence import DOUBTFUL

# Overlap of drawing and mask below which the object is lost, and above which a mask is held to be good.
LOST_OVERLAP, GOOD_OVERLAP = 0.6, 0.85
# Times the expected energy above which the object is lost too, and how fast the expectation follows.
UNUSUAL, LEARNING_RATE = 2.0, 0.2
# Degrees from one frame to the next that are a jump to another pose, and frames without one until a pose is trusted.
JUMP_DEG, FRAMES_AFTER_JUMP = 30.0, 5


@dataclass
class TrackQuality:
    """What is expected of the next frame.

    Args:
        symmetry: symmetry of the object.
        rotation: (3, 3) in the last frame.
        expected: energy of an answer that explains its frame; it follows the frames.
        fitted: energy of the last frame that was fitted from nothing.
        calm: number of frames since a jump.
    """

    symmetry: Symmetry
    rotation: Tensor
    expected: float
    fitted: float
    calm: int = FRAMES_AFTER_JUMP

    def assess(self, energy: float, overlap: float, rotation: Tensor, confidence: float) -> tuple[bool, float]:
        """Whether the object is lost in a frame, and the confidence in its pose.

        Args:
            energy: energy of the frame's answer.
            overlap: intersection over union of drawing and mask.
            rotation: (3, 3).
            confidence: by the pose's own evidence.
        """
        lost = overlap < LOST_OVERLAP or self.is_unusual(energy)
        jump = rotation_error(rotation, self.rotation, self.symmetry).rad2deg() > JUMP_DEG
        self.calm, self.rotation = 0 if jump else self.calm + 1, rotation
        doubtful = lost or overlap < GOOD_OVERLAP or energy > UNUSUAL * self.fitted or self.calm < FRAMES_AFTER_JUMP
        return lost, min(confidence, DOUBTFUL) if doubtful else confidence

    def is_unusual(self, energy: float) -> bool:
        """Whether an energy is that of something else than the object."""
        return energy > UNUSUAL * self.expected

    def learn(self, energy: float) -> None:
        """Let the expected energy follow that of a frame."""
        self.expected += LEARNING_RATE * (min(energy, UNUSUAL * self.expected) - self.expected)

    def fitted_anew(self, energy: float) -> TrackQuality:
        """What is expected after a frame was fitted from nothing; what was found there may be something else."""
        return replace(self, expected=self.expected if self.is_unusual(energy) else energy, fitted=energy)
