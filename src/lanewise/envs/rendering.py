"""A state of an environment as a picture, drawn without a window."""

from typing import Any

import jax
import numpy as np
from numpy.typing import NDArray

from lanewise.envs.functional import EnvConfig, State
from lanewise.evaluation.episodes import Recording
from lanewise.report.frame import frame
from lanewise.scenario import trap
from lanewise.world.state import World


def picture(config: EnvConfig, state: State, *, success: bool, accident: int) -> NDArray[np.uint8]:
    """The road around the ego from above, with time, speed, goal and rewards; [240, 960, 3].

    Args:
        config: of the environment.
        state: of one world.
        success: whether the episode has succeeded by now.
        accident: code of the accident that ended it, 0 if none did.
    """
    fetched: State = jax.device_get(state)
    goal = getattr(fetched.memory, "goal", None)
    return drawn(
        fetched.episode.world,
        time=int(fetched.episode.stats.decisions) * config.rules.driving.decision_duration,
        goal=(-1, np.nan) if goal is None else (int(goal.goal.lane), float(goal.goal.speed)),
        reward=float(fetched.reward),
        timestep_reward=float(fetched.episode.stats.timestep_reward),
        success=success,
        accident=accident,
    )


def drawn(
    world: World,
    *,
    time: float,
    goal: tuple[int, float],
    reward: float,
    timestep_reward: float,
    success: bool,
    accident: int,
) -> NDArray[np.uint8]:
    """A world in NumPy as a picture."""

    def one(value: Any, dtype: Any = np.float64) -> Any:
        return np.asarray(value, dtype)[None]

    road, vehicles = world.road, world.vehicles
    lanes = np.asarray(road.present)
    still = Recording(
        controller="lanewise",
        time=one(time),
        x=one(vehicles.x),
        y=one(vehicles.y),
        heading=one(vehicles.heading),
        speed=one(vehicles.speed),
        crashed=one(vehicles.crashed, np.bool_),
        present=np.asarray(vehicles.present),
        role=trap.roles(world),
        length=np.asarray(world.drivers.length, np.float64),
        width=np.asarray(world.drivers.width, np.float64),
        lane_centre=np.asarray(road.centre, np.float64)[lanes],
        lane_width=np.asarray(road.width, np.float64)[lanes],
        goal_lane=one(goal[0], np.int64),
        goal_speed=one(goal[1]),
        goals_ended=one(0, np.int64),
        goals_timed_out=one(0, np.int64),
        reward=one(reward),
        accumulated_reward=one(timestep_reward),
        escaped=one(success, np.bool_),
        accident=accident,
    )
    return np.asarray(frame(still, time))
