"""The same starts under the same random actions in our world and in highway-env: how each ends."""

import time
from collections.abc import Callable
from typing import Any

from lanewise.bench import random_driving
from lanewise.bench.random_driving import TRUNCATED, Drive
from lanewise.bench.workers import highway_env_world


def prepare(vehicles: int, lanes: int, count: int, seed: int) -> Callable[[], dict[str, Any]]:
    """Drives ours; the result drives highway-env's and compares."""
    drive = Drive(vehicles, lanes)
    ours = random_driving.endings(drive, seed, count)

    def measure() -> dict[str, Any]:
        began = time.perf_counter()
        theirs = [ending(drive, *start) for start in random_driving.prepared(drive, seed, count)]
        pairs = [(int(a), b) for a, b in zip(ours, theirs, strict=True)]
        return {
            "seconds": time.perf_counter() - began,
            "same": sum(a == b for a, b in pairs),
            "different": [[i, a, b] for i, (a, b) in enumerate(pairs) if a != b],
        }

    return measure


def ending(drive: Drive, world: Any, actions: Any) -> int:
    """Code of an episode's ending in highway-env."""
    env = highway_env_world.live(drive, world)
    for action in actions:
        code = highway_env_world.step(drive, env, action)
        if code:
            break
    env.close()
    return code or TRUNCATED
