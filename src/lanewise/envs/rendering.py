"""A state of an environment as a picture, drawn without a window."""

from dataclasses import replace

import jax
import numpy as np
from numpy.typing import NDArray

from lanewise.envs.control import EnvConfig
from lanewise.envs.functional import State
from lanewise.evaluation import stepwise
from lanewise.report.frame import frame


def picture(config: EnvConfig, state: State) -> NDArray[np.uint8]:
    """The road around the ego from above, with time, speed, goal and rewards; [240, 960, 3]."""
    # A recording of one frame.
    frames: State = jax.tree.map(lambda leaf: np.asarray(leaf)[None], jax.device_get(state))
    goal = getattr(frames.memory, "goal", None)
    still = stepwise.recording("lanewise", config.driving, frames.episode, goal)
    # That of the step, which may be several decisions.
    still = replace(still, reward=np.asarray(frames.reward, np.float64))
    return np.asarray(frame(still, still.time[0]))
