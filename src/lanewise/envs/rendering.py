"""A state of an environment as a picture, drawn without a window."""

from typing import Any

import jax
import numpy as np
from numpy.typing import NDArray

from lanewise.envs.control import EnvConfig
from lanewise.envs.functional import State
from lanewise.evaluation.episodes import Recording
from lanewise.report.frame import frame
from lanewise.scenario import trap


def picture(config: EnvConfig, state: State, *, success: bool, accident: int) -> NDArray[np.uint8]:
    """The road around the ego from above, with time, speed, goal and rewards; [240, 960, 3]."""

    def one(value: Any, dtype: Any = np.float64) -> Any:
        return np.asarray(value, dtype)[None]

    fetched: State = jax.device_get(state)
    world, stats = fetched.episode.world, fetched.episode.stats
    road, vehicles, lanes = world.road, world.vehicles, world.road.present
    under_way = getattr(fetched.memory, "goal", None)
    time = int(stats.decisions) * config.driving.decision_duration
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
        goal_lane=one(-1 if under_way is None else under_way.goal.lane, np.int64),
        goal_speed=one(np.nan if under_way is None else under_way.goal.speed),
        goals_ended=one(0, np.int64),
        goals_timed_out=one(0, np.int64),
        reward=one(fetched.reward),
        accumulated_reward=one(stats.timestep_reward),
        escaped=one(success, np.bool_),
        accident=accident,
    )
    return np.asarray(frame(still, time))
