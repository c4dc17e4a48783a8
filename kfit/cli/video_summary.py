"""The summary of a tracked video."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from kfit.tracking import TrackedPose


@dataclass
class VideoSummary:
    """Counts over the frames of a video.

    Attributes:
        num_frames: number of frames.
        num_anew: number of frames after the first in which the object was found anew.
        confidences: confidences of the frames in which it was found.
        seconds: time that the video took.
    """

    num_frames: int = 0
    num_anew: int = 0
    confidences: list[float] = field(default_factory=list)
    seconds: float = 0.0

    def add(self, pose: TrackedPose) -> None:
        """Add the next frame."""
        self.confidences += [pose.confidence] if pose.found else []
        self.num_anew += pose.anew and self.num_frames > 0
        self.num_frames += 1

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers of frames, and their confidences."""
        from kfit.reports.words import confidence_level

        levels = [confidence_level(confidence) for confidence in self.confidences]
        return {
            "frames": self.num_frames,
            "found": len(levels),
            "found_anew": self.num_anew,
            **{f"{level}_confidence": levels.count(level) for level in ("high", "medium", "low")},
            "median_confidence": sorted(self.confidences)[len(levels) // 2] if levels else None,
        }

    def sentence(self, category: str) -> str:
        """Return the numbers in one line, for an object of a category."""
        numbers = self.to_dict()
        found, frames, median = numbers["found"], numbers["frames"], numbers["median_confidence"]
        if not found:
            return f"{category} found in none of {frames} frames"
        anew = f", {self.num_anew} time{'s' if self.num_anew > 1 else ''} anew" if self.num_anew else ""
        low = f", unsure in {numbers['low_confidence']}" if numbers["low_confidence"] else ""
        return (
            f"{category} found in {found} of {frames} frames{anew}; confidence {100 * median:.0f} % in the "
            f"median, at least 80 % in {numbers['high_confidence']} frames{low}; {frames / self.seconds:.1f} "
            "frames a second"
        )
