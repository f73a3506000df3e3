"""What one seed of a controller left behind, and the measures that claims are computed from."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lanewise.evaluation.episodes import Recording
from lanewise.evaluation.metrics import TRAINING_WINDOW

EXPLORING = 100
"""At least so many first episodes are the initial exploration phase: with one world epsilon settles
within the first few of the paper's 2000."""
ENDING = 5.0
"""The end of a drive, over which its speed is averaged, s."""
BRAKING = 5.0
"""The first timesteps, in which both slow down, s."""
MEASURES = ("success", "reward", "speed")
"""What the paper's training figure shows: its success, and the reward of a decision, as lengths
differ."""


@dataclass(frozen=True)
class Evidence:
    """What one seed of one controller left behind."""

    training: Sequence[Mapping[str, Any]]
    """Its training episodes, in their order: metrics lines of kind ``episode``."""
    settled: int
    """Episodes completed when epsilon had come down to its final value; all, if it never did."""
    test: Mapping[str, float]
    """Its metrics in tests, by name (`Summary.values`)."""
    recording: Recording | None = None
    """One drive from the test start; of the two compared controllers alone."""

    @property
    def early_success(self) -> float:
        """Success rate in the initial exploration phase."""
        return _mean(self._values("success")[: self._explored])

    def around(self, name: str) -> float:
        """Mean of the window that ends with the initial exploration phase."""
        end = self._explored
        return _mean(self._values(name)[max(0, end - TRAINING_WINDOW) : end])

    def late(self, name: str) -> float:
        """Mean of the last training episodes."""
        return _mean(self._values(name)[-TRAINING_WINDOW:])

    def spread(self, name: str) -> float:
        """Standard deviation over the last training episodes."""
        last = self._values(name)[-TRAINING_WINDOW:]
        return float(last.std()) if len(last) else 0.0

    def relative_spread(self, name: str) -> float:
        """Standard deviation over mean; infinite around 0."""
        mean = abs(self.late(name))
        return self.spread(name) / mean if mean else inf

    @property
    def drive(self) -> Recording:
        """The drive, where there is one."""
        assert self.recording is not None, "only the two compared controllers are driven"
        return self.recording

    @property
    def final_speed(self) -> float:
        """The ego's mean speed at the end of the drive, m/s."""
        last = self.drive.time > self.drive.time[-1] - ENDING
        return float(self.drive.speed[last, 0].mean())

    @property
    def lowest_speed(self) -> float:
        """The ego's lowest speed in the first timesteps of the drive, m/s."""
        return float(self.drive.speed[self.drive.time <= BRAKING, 0].min())

    def rewards_at(self, time: float) -> tuple[float, float]:
        """(instant, accumulated) reward at a time, or at the end of a shorter drive."""
        frame = int(np.flatnonzero(self.drive.time <= time)[-1])
        return float(self.drive.reward[frame]), float(self.drive.accumulated_reward[frame])

    @property
    def gaps(self) -> tuple[float, float, float]:
        """From the ego to the trap car ahead of it at the start: first, largest and last, m."""
        gap = self.drive.x[:, 1] - self.drive.x[:, 0]
        return float(gap[0]), float(gap.max()), float(gap[-1])

    @property
    def _explored(self) -> int:
        """Episodes of the initial exploration phase."""
        return max(EXPLORING, self.settled)

    def _values(self, name: str) -> NDArray[np.float64]:
        """A measure by training episode."""
        if name == "reward":
            values = [line["reward"] / max(1, line["decisions"]) for line in self.training]
        else:
            values = [line["escaped" if name == "success" else name] for line in self.training]
        return np.array(values, np.float64)


def _mean(values: NDArray[np.float64]) -> float:
    return float(values.mean()) if len(values) else 0.0
