"""Compare our world with highway-env's, tick by tick and run by run. Needs 64-bit JAX."""

from dataclasses import asdict, replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from highway_env.envs import HighwayEnv
from jax import lax

from lanewise.interop.highway_env import build_env, command_table, read_world
from lanewise.world import bicycle, tick
from lanewise.world.state import RULE_BASED

CONTINUOUS = (
    "x",
    "y",
    "heading",
    "speed",
    "timer",
    "slip_sine",
    "acceleration",
    "impact_x",
    "impact_y",
)
DECISIONS = ("target_lane", "crashed", "impacted")
OF_RULES = ("timer", "target_lane")
"""Plain vehicles have neither."""
STATE_TOLERANCE = 1e-9
RUN_TOLERANCE = 1e-6


def stack(worlds):
    """One batch of worlds."""
    return jax.tree.map(lambda *values: np.stack(values), *worlds)


def errors_of(vehicles, reference, rule_based):
    """How far vehicles are from the reference, of each number and decision.

    Args:
        vehicles: arrays [..., n].
        reference: the same.
        rule_based: bool [n].

    Returns:
        By name, [..., n]; a decision's error is 0 or infinite.
    """
    errors = {}
    for name in CONTINUOUS + DECISIONS:
        value, wanted = getattr(vehicles, name), getattr(reference, name)
        if name in DECISIONS:
            error = np.where(value != wanted, np.inf, 0.0)
        else:
            error = np.abs(value - wanted)
        errors[name] = np.where(rule_based, error, 0.0) if name in OF_RULES else error
    return errors


def wreck_flags(vehicles, reference):
    """Which vehicles only one of the worlds pushes, by nothing, bool [..., n].

    Wrecks that were pushed apart touch but for rounding, so whether they are pushed once more is
    chance; it matters to nobody, as they have crashed already (`wrecks-at-rest`).
    """
    push_x, push_y = vehicles.impact_x - reference.impact_x, vehicles.impact_y - reference.impact_y
    nothing = np.maximum(np.abs(push_x), np.abs(push_y)) <= RUN_TOLERANCE
    wrecks = vehicles.crashed & reference.crashed
    return (vehicles.impacted != reference.impacted) & wrecks & nothing


def errors_but_flags(vehicles, reference, rule_based):
    """As `errors_of`, but for `wreck_flags`."""
    errors = errors_of(vehicles, reference, rule_based)
    flags = wreck_flags(vehicles, reference)
    return errors | {"impacted": np.where(flags, 0.0, errors["impacted"])}


def agree(errors, tolerance):
    """Which vehicles are within tolerance, bool [..., n]; not-a-number is outside."""
    return np.all([error <= tolerance for error in errors.values()], axis=0)


def largest_of(errors):
    """The largest error of each number, and the decisions that differ."""
    largest = {name: float(error.max(initial=0.0)) for name, error in errors.items()}
    unequal = [name for name in DECISIONS if largest.pop(name)]
    return largest, unequal


def differences(vehicles, world):
    """As `largest_of`, of the present vehicles against those of a world that is read."""
    present = np.flatnonzero(vehicles.present)
    vehicles = jax.tree.map(lambda values: values[present], vehicles)
    rule_based = np.asarray(world.drivers.kind) == RULE_BASED
    return largest_of(errors_of(vehicles, world.vehicles, rule_based))


def agrees(errors, unequal, tolerance):
    """Whether a comparison is within tolerance, not-a-number being outside."""
    return not unequal and all(error <= tolerance for error in errors.values())


@jax.jit
def one_tick(worlds, duration):
    """Vehicles of a batch of worlds, a tick later."""
    return jax.vmap(lambda world: tick.tick(world, duration))(worlds).vehicles


def reference_tick(world, frequency):
    """The same tick in highway-env."""
    env = build_env(world, simulation_frequency=frequency)
    env.road.act()
    env.road.step(1 / frequency)
    return read_world(env)


def compare_states(worlds, frequency=10):
    """Compare one tick of several worlds of one size.

    Returns:
        For each world its errors and unequal decisions.
    """
    ours = jax.tree.map(np.asarray, one_tick(stack(worlds), 1 / frequency))
    return [
        differences(jax.tree.map(lambda a, i=i: a[i], ours), reference_tick(world, frequency))
        for i, world in enumerate(worlds)
    ]


def minimised(world, frequency=10):
    """Leave vehicles out one by one as long as the mismatch stays."""
    for index in reversed(range(1, world.vehicles.x.shape[0])):
        present = world.vehicles.present.copy()
        if not present[index]:
            continue
        present[index] = False
        smaller = replace(world, vehicles=replace(world.vehicles, present=present))
        if not agrees(*compare_states([smaller], frequency)[0], STATE_TOLERANCE):
            world = smaller
    return world


def as_json(world):
    """A world as lists."""
    return jax.tree.map(lambda value: np.asarray(value).tolist(), asdict(world))


@jax.jit
def tick_by_tick(world, commands, duration):
    """Vehicles after each tick, [ticks, N].

    Args:
        world: one world.
        commands: for each tick and external vehicle [ticks, k]: its number, or -1 where nothing new
            is commanded; acceleration, m/s^2; steering, rad.
        duration: of a tick, s.
    """

    def advance(vehicles, given):
        now = replace(world, vehicles=vehicles)
        for vehicle, acceleration, steering in zip(*given, strict=True):
            now = bicycle.command(now, acceleration, steering, vehicle)
        vehicles = tick.tick(now, duration).vehicles
        return vehicles, vehicles

    return lax.scan(advance, world.vehicles, commands)[1]


@partial(jax.jit, static_argnames="ticks")
def free_run(worlds, commands, duration, ticks):
    """Vehicles after each decision, [decisions, worlds, N]; commands [decisions, worlds, 2]."""

    def decide(batch, command):
        def one(world, values):
            return tick.run(bicycle.command(world, values[0], values[1]), duration, ticks)

        batch = jax.vmap(one)(batch, command)
        return batch, batch.vehicles

    return lax.scan(decide, worlds, commands)[1]


def compare_runs(envs, worlds, actions):
    """Compare free runs decision by decision until each first differs.

    Args:
        envs: one live environment per run.
        worlds: their worlds, of one size.
        actions: int [runs, decisions].

    Returns:
        For each run: the decisions that agreed, the largest errors, the unequal decisions.
    """
    config = envs[0].config
    ticks = config["simulation_frequency"] // config["policy_frequency"]
    commands = np.stack(
        [command_table(env)[chosen] for env, chosen in zip(envs, actions, strict=True)], axis=1
    )
    duration = 1 / config["simulation_frequency"]
    ours = free_run(stack(worlds), jnp.asarray(commands), duration, ticks)
    ours = jax.tree.map(np.asarray, ours)
    results = []
    for run, env in enumerate(envs):
        largest = dict.fromkeys(CONTINUOUS, 0.0)
        unequal, agreed = [], 0
        for decision, action in enumerate(actions[run]):
            # Not env.step: it would spend most of its time on pandas observations.
            env._simulate(int(action))
            vehicles = jax.tree.map(lambda a, d=decision, r=run: a[d, r], ours)
            errors, unequal = differences(vehicles, read_world(env))
            if not agrees(errors, unequal, RUN_TOLERANCE):
                break
            agreed += 1
            largest = {name: max(largest[name], errors[name]) for name in CONTINUOUS}
        results.append((agreed, largest, unequal))
    return results


def default_env(seed):
    """highway-env's own default traffic: 50 vehicles, four lanes, 15 Hz, under DiscreteAction."""
    config = {
        "action": {
            "type": "DiscreteAction",
            "acceleration_range": (-1.0, 1.0),
            "steering_range": (-np.pi / 50, np.pi / 50),
        },
        "policy_frequency": 1,
        "simulation_frequency": 15,
    }
    env = HighwayEnv(config=config)
    env.reset(seed=seed)
    return env
