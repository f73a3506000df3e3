"""Compare vehicles of our world with highway-env's, and single ticks of both. Needs 64-bit JAX."""

from dataclasses import asdict, replace

import jax
import numpy as np

from lanewise.interop.highway_env import build_env, read_world
from lanewise.world import tick
from lanewise.world.state import RULE_BASED

CONTINUOUS = (
    *("x", "y", "heading", "speed", "timer"),
    *("slip_sine", "acceleration", "impact_x", "impact_y"),
)
DECISIONS = ("target_lane", "crashed", "impacted")
OF_RULES = ("timer", "target_lane")
"""Plain vehicles have neither."""
STATE_TOLERANCE = 1e-9
RUN_TOLERANCE = 1e-6


def stack(worlds):
    """One batch of worlds."""
    return jax.tree.map(lambda *values: np.stack(values), *worlds)


def at(vehicles, index):
    """Vehicles of one or several ticks or worlds: arrays by their first axis."""
    return jax.tree.map(lambda values: values[index], vehicles)


def errors_of(vehicles, reference, rule_based):
    """How far vehicles [..., n] are from the reference, by name of number and decision.

    A decision's error is 0 or infinite.
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
    chance. It matters to nobody, as they have crashed already (`wrecks-at-rest`).
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


def largest(errors):
    """The largest error of each number."""
    return {name: float(errors[name].max(initial=0.0)) for name in CONTINUOUS}


@jax.jit
def one_tick(worlds, duration):
    """Vehicles of a batch of worlds, a tick later, side by side as in training."""
    return jax.vmap(lambda world: tick.run(world, duration, 1))(worlds).vehicles


def reference_tick(world, frequency):
    """The same tick in highway-env."""
    env = build_env(world, simulation_frequency=frequency)
    env.road.act()
    env.road.step(1 / frequency)
    return read_world(env)


def compare_states(worlds, frequency=10):
    """The errors of one tick (`errors_of`) of several worlds of one size, present vehicles only."""
    ours = jax.tree.map(np.asarray, one_tick(stack(worlds), 1 / frequency))
    found = []
    for index, world in enumerate(worlds):
        theirs = reference_tick(world, frequency)
        vehicles = at(at(ours, index), np.flatnonzero(world.vehicles.present))
        found.append(errors_of(vehicles, theirs.vehicles, theirs.drivers.kind == RULE_BASED))
    return found


def minimised(world, frequency=10):
    """Leave vehicles out one by one as long as the mismatch of the next tick stays."""
    for index in reversed(range(1, world.vehicles.x.shape[0])):
        present = world.vehicles.present.copy()
        if not present[index]:
            continue
        present[index] = False
        smaller = replace(world, vehicles=replace(world.vehicles, present=present))
        if not agree(compare_states([smaller], frequency)[0], STATE_TOLERANCE).all():
            world = smaller
    return world


def as_json(world):
    """A world as lists."""
    return jax.tree.map(lambda value: np.asarray(value).tolist(), asdict(world))
