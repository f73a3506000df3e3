"""EnvPool's highway-env in C++ under random meta-actions. Needs only EnvPool and NumPy."""

import time
from collections.abc import Callable
from typing import Any

import envpool
import numpy as np


def prepare(
    task: str, envs: int, threads: int, seconds: float, settings: dict[str, Any], seed: int = 0
) -> Callable[[], dict[str, Any]]:
    """Makes the environments and takes a hundred steps; the result drives for ``seconds``.

    Args:
        task: EnvPool's name of the environment.
        envs: environments in the pool, all stepped in each call.
        threads: of the pool.
        seconds: to drive.
        settings: of the environment, where they differ from the task's own.
        seed: of environments and actions.
    """
    pool = envpool.make_gymnasium(task, num_envs=envs, num_threads=threads, seed=seed, **settings)
    config = pool.spec.config
    # Drawn before, so that the time is the pool's.
    actions = np.random.default_rng(seed).integers(0, pool.action_space.n, (1000, envs))
    pool.reset()
    for number in range(100):
        pool.step(actions[number])

    def measure() -> dict[str, Any]:
        decisions = steps = crashed = truncated = 0
        began = time.perf_counter()
        while time.perf_counter() - began < seconds:
            _, _, over, cut, _ = pool.step(actions[steps % len(actions)])
            steps += 1
            decisions += envs
            crashed += int(over.sum())
            truncated += int((cut & ~over).sum())
        return {
            "decisions": decisions,
            "seconds": time.perf_counter() - began,
            "ticks_per_decision": config.simulation_frequency // config.policy_frequency,
            "vehicles": config.vehicles_count + 1,
            "ended": {"collision": crashed, "truncated": truncated},
        }

    return measure
