"""The real highway-env under random driving, from the starts of our trap."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import timing

from lanewise.driving import accidents, actions
from lanewise.envs import functional
from lanewise.interop import highway_env_evaluation

STARTS = 64
ENDINGS = ("collision", "off_road", "stopped", "truncated")
"""By code from 1; those of accidents are `accidents`'."""
TRUNCATED = len(ENDINGS)


class Starts:
    """Starts of the trap with so many vehicles and lanes, and random actions for each."""

    def __init__(self, vehicles, lanes, seed, count=STARTS):
        self.task = functional.make(vehicles_ahead=vehicles - 3, lanes=lanes)
        keys = jax.random.split(jax.random.key(seed), count)
        self.states, _ = jax.vmap(partial(functional.reset, self.task))(keys)
        worlds = jax.device_get(self.states.episode.world)
        self.worlds = [jax.tree.map(lambda leaf, i=i: leaf[i], worlds) for i in range(count)]
        rng = np.random.default_rng(seed)
        self.actions = rng.integers(0, actions.COUNT, (count, self.task.duration))

    def env(self, index):
        """highway-env at a start; after the last one they begin again."""
        world = self.worlds[index % len(self.worlds)]
        return highway_env_evaluation.live(self.task.driving, world, self.task.duration)

    def accident(self, env):
        """Code of the accident the ego is in."""
        if env.vehicle.crashed:
            return accidents.COLLISION
        if not env.vehicle.on_road:
            return accidents.OFF_ROAD
        stopped = env.vehicle.speed < self.task.driving.stopped_speed
        return accidents.STOPPED if stopped else accidents.NONE


def world(vehicles, lanes, seconds, seed=0, latency=False):
    """Vehicle-ticks/s of one environment; microseconds a decision if ``latency``."""
    starts = Starts(vehicles, lanes, seed)
    ended = dict.fromkeys(ENDINGS, 0)
    env, index, decisions = starts.env(0), 0, 0

    def decide():
        nonlocal env, index, decisions
        env.step(int(starts.actions[index % STARTS, decisions]))
        decisions += 1
        code = starts.accident(env)
        if code or decisions == starts.task.duration:
            ended[ENDINGS[(code or TRUNCATED) - 1]] += 1
            env.close()
            index, decisions = index + 1, 0
            env = starts.env(index)

    decide()

    def timed():
        rate = timing.calls_per_second(decide, seconds)
        if latency:
            return timing.result(1e6 / rate, "microseconds a decision", ended=ended)
        return timing.driving(rate, vehicles, starts.task.driving.ticks_per_decision, ended)

    return timed


def same_endings(vehicles, lanes, count, seed=0):
    """How many starts end alike in our world and in highway-env, under the same actions."""
    starts = Starts(vehicles, lanes, seed, count)
    ours = np.asarray(_endings(starts))

    def timed():
        theirs = [_ending(starts, index) for index in range(count)]
        pairs = [(int(a), b) for a, b in zip(ours, theirs, strict=True)]
        different = [[i, a, b] for i, (a, b) in enumerate(pairs) if a != b]
        same = float(count - len(different))
        return timing.result(same, "end as in highway-env", different=different)

    return timed


def _endings(starts):
    """[count] codes of how the starts end in our world."""

    def decide(carry, action):
        states, codes = carry
        states, steps = jax.vmap(partial(functional.step, starts.task))(states, action)
        return (states, jnp.where(codes == 0, steps.accident, codes)), None

    none = jnp.zeros(len(starts.worlds), jnp.int32)
    (_, codes), _ = jax.jit(partial(jax.lax.scan, decide))(
        (starts.states, none), jnp.asarray(starts.actions.T)
    )
    return jnp.where(codes == 0, TRUNCATED, codes)


def _ending(starts, index):
    """Code of how a start ends in highway-env."""
    env = starts.env(index)
    for action in starts.actions[index]:
        env.step(int(action))
        if code := starts.accident(env):
            break
    env.close()
    return code or TRUNCATED
