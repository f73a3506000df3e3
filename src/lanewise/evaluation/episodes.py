"""What a test leaves behind: one row an episode, and frame by frame for those that are watched."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

ACCIDENTS = ("none", "collision", "off_road", "stopped")
"""Names of the accident codes, in order; the code is the index."""

ACCIDENT_KINDS = {
    "none": "no accident",
    "car_ahead": "ran into the car ahead",
    "own_lane_change": "hit the car ahead after a lane change",
    "cut_in": "ran into a car that cut in",
    "side_swipe": "side-swiped a car",
    "side_swiped": "was side-swiped",
    "hit_from_behind": "was hit from behind",
    "off_road": "left the road",
    "stopped": "stopped",
}
"""Names of the codes of `lanewise.driving.accident_kinds`, in order, and in words."""

ROLES = ("ego", "trap", "traffic")
"""Names of the vehicle roles, in order; the role is the index."""


@dataclass(frozen=True)
class Episodes:
    """Outcomes of E test episodes, in the order of their starts."""

    success: NDArray[np.bool_]
    """[E] the ego's rear passed the front of every trap car, and no accident happened."""
    accident: NDArray[np.int8]
    """[E] index into `ACCIDENTS`."""
    accident_kind: NDArray[np.int8]
    """[E] index into `ACCIDENT_KINDS`."""
    accumulated_reward: NDArray[np.float64]
    """[E] sum of the rewards at the end of each timestep (1 s); an accident adds its penalty."""
    average_speed: NDArray[np.float64]
    """[E] mean of the ego's speed at the end of each decision, m/s."""
    travel_distance: NDArray[np.float64]
    """[E] along the road from the start, m."""
    duration: NDArray[np.float64]
    """[E] s; shorter than the test when an accident ended it."""
    escape_time: NDArray[np.float64]
    """[E] s until the ego was first past the trap; NaN if it never was."""
    goals: NDArray[np.int64]
    """[E] goals that ended (reached or given up); 0 for a controller without goals."""
    goals_timed_out: NDArray[np.int64]
    """[E] of those, how many were given up."""

    def __len__(self) -> int:
        return len(self.success)

    def __repr__(self) -> str:
        return f"Episodes({len(self)} of {', '.join(self.__dataclass_fields__)})"

    def some(self, which: slice) -> "Episodes":
        """Some of them."""
        return Episodes(**{name: values[which] for name, values in vars(self).items()})

    @property
    def escaped(self) -> NDArray[np.bool_]:
        """[E] the paper's success: past every trap car at some time, whatever happened later."""
        return ~np.isnan(self.escape_time)


@dataclass(frozen=True)
class Recording:
    """One episode frame by frame: T decisions' ends, the first frame being the start."""

    controller: str
    """Name of the controller."""
    time: NDArray[np.float64]
    """[T] s."""
    x: NDArray[np.float64]
    """[T, N] m."""
    y: NDArray[np.float64]
    """[T, N] m, positive to the right."""
    heading: NDArray[np.float64]
    """[T, N] rad, positive to the right."""
    speed: NDArray[np.float64]
    """[T, N] m/s."""
    crashed: NDArray[np.bool_]
    """[T, N]."""
    present: NDArray[np.bool_]
    """[N]."""
    role: NDArray[np.int8]
    """[N] index into `ROLES`."""
    length: NDArray[np.float64]
    """[N] m."""
    width: NDArray[np.float64]
    """[N] m."""
    lane_centre: NDArray[np.float64]
    """[M] m."""
    lane_width: NDArray[np.float64]
    """[M] m."""
    goal_lane: NDArray[np.int64]
    """[T] lane the high level asked for at that moment; -1 for a controller without goals."""
    goal_speed: NDArray[np.float64]
    """[T] m/s; NaN for a controller without goals."""
    goals_ended: NDArray[np.int64]
    """[T] goals that had ended (reached or given up) when the decision that ended there was taken:
    it grows in the frame where the next goal first stands; 0 for a controller without goals."""
    goals_timed_out: NDArray[np.int64]
    """[T] of those, how many were given up."""
    reward: NDArray[np.float64]
    """[T] reward of the decision that ended there; 0 in the first frame."""
    accumulated_reward: NDArray[np.float64]
    """[T] the paper's sum so far: one reward a second."""
    escaped: NDArray[np.bool_]
    """[T] has the ego been past the trap by then."""
    accident: int
    """Index into `ACCIDENTS`."""
    accident_kind: int = 0
    """Index into `ACCIDENT_KINDS`; 0 too where nobody has told it."""

    @property
    def ending(self) -> str:
        """The accident that ended it, in words."""
        if self.accident_kind:
            return list(ACCIDENT_KINDS.values())[self.accident_kind]
        return ACCIDENTS[self.accident].replace("_", " ")

    def __repr__(self) -> str:
        return f"Recording({len(self.time)} frames of {', '.join(self.__dataclass_fields__)})"
