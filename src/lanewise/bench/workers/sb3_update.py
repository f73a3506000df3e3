"""Stable-Baselines3's own DQN update, sampling included. Needs only Stable-Baselines3.

Its DQN is not a double one and so makes two forward passes where ours makes three.
"""

import os
import time
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import torch
from stable_baselines3 import DQN
from stable_baselines3.common.logger import configure

UPDATES = 100
"""In a call of ``DQN.train``."""


class _Nothing(gymnasium.Env[Any, Any]):
    """Spaces without a world."""

    def __init__(self, inputs: int, outputs: int) -> None:
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (inputs,))
        self.action_space = gymnasium.spaces.Discrete(outputs)


def prepare(
    inputs: int,
    outputs: int,
    hidden: list[int],
    batch: int,
    capacity: int,
    learning_rate: float,
    discount: float,
    seconds: float,
    seed: int = 0,
) -> Callable[[], dict[str, Any]]:
    """Fills a replay and warms up; the result updates for ``seconds``."""
    torch.set_num_threads(len(os.sched_getaffinity(0)))
    model = DQN(
        "MlpPolicy",
        _Nothing(inputs, outputs),
        policy_kwargs={"net_arch": hidden},
        batch_size=batch,
        buffer_size=capacity,
        learning_rate=learning_rate,
        gamma=discount,
        seed=seed,
        device="cpu",
    )
    model.set_logger(configure(None, []))
    random = np.random.default_rng(seed)
    memory = model.replay_buffer
    memory.observations[:] = random.normal(size=memory.observations.shape)
    memory.next_observations[:] = random.normal(size=memory.observations.shape)
    memory.actions[:] = random.integers(0, outputs, memory.actions.shape)
    memory.rewards[:] = random.normal(size=memory.rewards.shape)
    memory.full = True
    model.train(gradient_steps=UPDATES, batch_size=batch)

    def measure() -> dict[str, Any]:
        done, began = 0, time.perf_counter()
        while time.perf_counter() - began < seconds:
            model.train(gradient_steps=UPDATES, batch_size=batch)
            done += UPDATES
        return {"updates": done, "seconds": time.perf_counter() - began}

    return measure
