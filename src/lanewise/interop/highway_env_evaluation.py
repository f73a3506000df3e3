"""Greedy test episodes in the real highway-env, from the same starts as in our world.

The percept comes from the live environment's state through *our* observation, and at every
decision it is checked against highway-env's own ``Kinematics`` observation.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from lanewise.controllers.controller import Memory
from lanewise.driving import observation
from lanewise.driving.settings import DrivingSettings, ObservationSettings
from lanewise.errors import LanewiseError, SettingsError
from lanewise.evaluation import evaluator
from lanewise.evaluation.evaluator import Drive, EvaluationConfig
from lanewise.interop import highway_env
from lanewise.system import pinned
from lanewise.world.state import World

OBSERVATION_TOLERANCE = 1e-4
"""Largest difference allowed between highway-env's observation and ours, both scaled its way."""


class HighwayEnv:
    """highway-env as a `lanewise.evaluation.stepwise.Simulator`: one episode at a time."""

    size = 1

    def __init__(self) -> None:
        self._env: Any = None
        self._observed: Any = None

    def begin(self, config: EvaluationConfig, seed: int, first: int) -> Drive:
        """Episode ``first`` of a seed at its start, which is the one of our world; [1]."""
        world = jax.device_get(evaluator.start(config, seed, first))
        self._env = live(config.driving, world, config.duration, config.split != "test")
        self._observed = self._env.observation_type.observe()
        found: Drive = _begin(config, read(self._env))
        return found

    def step(self, config: EvaluationConfig, drive: Drive, memory: Memory, action: Array) -> Drive:
        """The drive after a decision, [1].

        Raises:
            LanewiseError: the action is continuous, or highway-env observed something else than we.
        """
        if jnp.issubdtype(action.dtype, jnp.floating):
            raise LanewiseError(
                "continuous actions are not driven in highway-env here; evaluate in lanewise"
            )
        _check(self._observed, _expected(drive.episode.world))
        self._observed = self._env.step(int(action[0]))[0]
        found: Drive = _conclude(config, drive, memory, action, read(self._env))
        if found.episode.outcome.over[0]:
            self._env.close()
        return found


def live(driving: DrivingSettings, world: World, duration: int, training: bool = False) -> Any:
    """highway-env at the start of an episode of so many decisions.

    In ``training`` the latency is as set for it.

    Raises:
        SettingsError: decisions have a latency, speeds swing, or others than vehicle 0 are driven
            from outside too.
    """
    if any(driving.latency_ticks(training)):
        name = "training_latency" if training and driving.training_latency else "latency"
        raise SettingsError(f"driving.{name}: in highway-env decisions take effect at once")
    env = highway_env.build_env(
        world,
        simulation_frequency=driving.simulation_frequency,
        decision_frequency=driving.decision_frequency,
        acceleration=driving.actions.acceleration,
        steering=driving.actions.steering,
        duration=duration * driving.decision_duration,
    )
    if env.controlled_vehicles != [env.road.vehicles[0]]:
        raise SettingsError("only vehicle 0 can be driven here; make the others CONSTANT")
    return env


@pinned.switches()
def read(env: Any) -> World:
    """The world of a live environment in the precision of training: what controllers learnt on."""

    def narrow(leaf: Any) -> Array:
        array = np.asarray(leaf)
        return jnp.asarray(array.astype(np.float32) if array.dtype == np.float64 else array)

    narrowed: World = jax.tree.map(narrow, highway_env.read_world(env))
    return narrowed


@pinned.jit(static_argnums=0)
def _begin(config: EvaluationConfig, world: World) -> Drive:
    return _batch_of_one(evaluator.begin(config, world))


@pinned.jit(static_argnums=0)
def _conclude(
    config: EvaluationConfig, drive: Drive, memory: Memory, action: Array, world: World
) -> Drive:
    drive, memory, action = jax.tree.map(lambda leaf: leaf[0], (drive, memory, action))
    return _batch_of_one(evaluator.conclude(config, drive, memory, action, world))


def _batch_of_one(drive: Drive) -> Drive:
    batch: Drive = jax.tree.map(lambda leaf: leaf[None], drive)
    return batch


@pinned.jit()
def _expected(world: World) -> Array:
    """The observation highway-env should make of a world, [1, 5, 5]; the world is [1]."""
    theirs = ObservationSettings(scaling="highway-env")
    ego, others, _ = jax.vmap(lambda world: observation.scaled(theirs, world))(world)
    return jnp.concatenate([ego[:, None], others], axis=1)


def _check(theirs: Any, ours: Array) -> None:
    """Stop when the two observations differ: one of them is wrong, and no result would count.

    The order of vehicles that are equally near is the list's in both.
    """
    difference = float(np.max(np.abs(theirs - np.asarray(ours[0]))))
    if not difference < OBSERVATION_TOLERANCE:
        raise LanewiseError(
            f"highway-env observes something else than we do, off by {difference:.2g}: "
            "no result would count; please report the settings and the seed"
        )
