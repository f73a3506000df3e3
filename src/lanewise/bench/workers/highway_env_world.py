"""The real highway-env under the same random driving, from the same starts."""

import time
from collections.abc import Callable
from typing import Any

from lanewise.bench import random_driving
from lanewise.bench.random_driving import ENDINGS, TRUNCATED, Drive
from lanewise.driving import accidents
from lanewise.interop import drive as live_drive

STARTS = 64


def prepare(vehicles: int, lanes: int, seconds: float, seed: int) -> Callable[[], dict[str, Any]]:
    """Draws starts and takes a first step; the result drives for ``seconds``."""
    drive = Drive(vehicles, lanes)
    starts = random_driving.prepared(drive, seed, STARTS)
    step(drive, live(drive, starts[0][0]), starts[0][1][0])

    def measure() -> dict[str, Any]:
        ended = [0] * (TRUNCATED + 1)
        decisions, episodes, anew = 0, 0, 0.0
        began = time.perf_counter()
        while time.perf_counter() - began < seconds:
            world, actions = starts[episodes % STARTS]
            asked = time.perf_counter()
            env = live(drive, world)
            anew += time.perf_counter() - asked
            code = TRUNCATED
            for action in actions:
                code = step(drive, env, action)
                decisions += 1
                if code or time.perf_counter() - began > seconds:
                    break
            else:
                code = TRUNCATED
            ended[code] += 1
            episodes += 1
            env.close()
        return {
            "decisions": decisions,
            "seconds": time.perf_counter() - began,
            "ticks_per_decision": drive.driving.ticks_per_decision,
            "ended": dict(zip(ENDINGS, ended[1:], strict=True)),
            "reset_seconds": anew,
        }

    return measure


def live(drive: Drive, world: Any) -> Any:
    """highway-env at a start."""
    return live_drive.live(drive.driving, world, drive.duration)


def step(drive: Drive, env: Any, action: Any) -> int:
    """One decision with its observation: the accident's code."""
    env.step(int(action))
    if env.vehicle.crashed:
        return accidents.COLLISION
    if not env.vehicle.on_road:
        return accidents.OFF_ROAD
    return accidents.STOPPED if env.vehicle.speed < drive.driving.stopped_speed else accidents.NONE
