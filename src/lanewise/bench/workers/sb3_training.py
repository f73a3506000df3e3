"""Stable-Baselines3's DQN on the trap in the real highway-env, with an update every step.

Network, batch, replay and step size are those of our training. Needs Stable-Baselines3, and
Lanewise with highway-env for the starts.
"""

import os
import time
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import torch
from stable_baselines3 import DQN
from stable_baselines3.common.callbacks import BaseCallback

from lanewise.bench import random_driving
from lanewise.bench.random_driving import Drive
from lanewise.driving import accidents
from lanewise.interop import drive as live_drive
from lanewise.learning.settings import LearnerSettings

STARTS = 64


class Trap(gymnasium.Env[Any, Any]):
    """The trap in the real highway-env, with its own observation and a reward for speed."""

    def __init__(self, drive: Drive, seed: int) -> None:
        self._drive = drive
        self._starts = [world for world, _ in random_driving.prepared(drive, seed, STARTS)]
        self._episode = 0
        self._env: Any = None
        self.observation_space = gymnasium.spaces.Box(-1.0, 1.0, (25,))
        self.action_space = gymnasium.spaces.Discrete(9)

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        """The next start."""
        super().reset(seed=seed)
        world = self._starts[self._episode % STARTS]
        self._env = live_drive.live(self._drive.driving, world, self._drive.duration)
        self._episode += 1
        return self._seen(self._env.observation_type.observe()), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """One decision."""
        seen, _, _, truncated, _ = self._env.step(int(action))
        ego = self._env.vehicle
        code = accidents.COLLISION if ego.crashed else accidents.NONE
        if not ego.on_road or ego.speed < self._drive.driving.stopped_speed:
            code = accidents.OFF_ROAD
        reward = -10.0 if code else float(np.clip((ego.speed - 5.0) / 10.0, 0.0, 1.0))
        return self._seen(seen), reward, bool(code), bool(truncated), {}

    @staticmethod
    def _seen(table: Any) -> Any:
        return np.asarray(table, np.float32).ravel()


class _Until(BaseCallback):  # type: ignore[misc]
    """Stops after so many seconds."""

    def __init__(self, seconds: float) -> None:
        super().__init__()
        self._seconds = seconds

    def _on_training_start(self) -> None:
        self._began = time.perf_counter()

    def _on_step(self) -> bool:
        return time.perf_counter() - self._began < self._seconds


class _Clock:
    """Adds up the time spent in a function."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function
        self.seconds, self.calls = 0.0, 0

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        began = time.perf_counter()
        found = self._function(*arguments, **named)
        self.seconds += time.perf_counter() - began
        self.calls += 1
        return found


def prepare(vehicles: int, seconds: float, seed: int = 0) -> Callable[[], dict[str, Any]]:
    """Trains past the warm-up; the result trains for ``seconds``."""
    torch.set_num_threads(len(os.sched_getaffinity(0)))
    settings = LearnerSettings()
    trap: Any = Trap(Drive(vehicles), seed)
    model = DQN(
        "MlpPolicy",
        trap,
        policy_kwargs={"net_arch": list(settings.hidden)},
        batch_size=settings.batch_size,
        buffer_size=settings.replay_capacity,
        learning_rate=settings.learning_rate,
        gamma=settings.discount,
        learning_starts=100,
        train_freq=1,
        gradient_steps=1,
        seed=seed,
        device="cpu",
    )
    model.learn(110)

    def measure() -> dict[str, Any]:
        first = model.num_timesteps
        stepping, learning = _Clock(trap.step), _Clock(model.train)
        trap.step, model.train = stepping, learning
        began = time.perf_counter()
        model.learn(10_000_000, callback=_Until(seconds), reset_num_timesteps=False)
        took = time.perf_counter() - began
        return {
            "steps": model.num_timesteps - first,
            "updates": learning.calls,
            "seconds": took,
            "breakdown": {
                "driving": stepping.seconds,
                "updates": learning.seconds,
                "host": took - stepping.seconds - learning.seconds,
            },
        }

    return measure
