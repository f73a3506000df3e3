"""Random worlds on which ours is compared with highway-env's, as float64 NumPy arrays."""

from dataclasses import replace

import jax
import numpy as np

from lanewise.scenario import trap
from lanewise.scenario.settings import TrapSettings
from lanewise.world.state import (
    CONSTANT,
    EXTERNAL,
    RULE_BASED,
    Drivers,
    Linear,
    Road,
    Vehicles,
    World,
)

SIZES = (16, 32)
LANES_MAX = 5


def random_road(rng):
    """Two to five lanes, now and then a short road, a closed lane, or other widths and limits."""
    count = int(rng.integers(2, LANES_MAX + 1))
    present = np.arange(LANES_MAX) < count
    width = 4.0 if rng.random() < 0.8 else float(rng.uniform(3.0, 5.0))
    limits = np.full(LANES_MAX, 30.0)
    if rng.random() < 0.2:
        limits = rng.uniform(5.0, 35.0, LANES_MAX)
    closed = (rng.random(LANES_MAX) < 0.5) & (rng.random() < 0.1)
    return Road(
        present=present,
        centre=np.arange(LANES_MAX) * width,
        width=np.full(LANES_MAX, width),
        start=np.zeros(LANES_MAX),
        end=np.full(LANES_MAX, 200.0 if rng.random() < 0.1 else 10_000.0),
        speed_limit=limits,
        open_to_change=present & ~closed,
    )


def slip_sine(steering):
    """Sine of the slip angle of a steering angle."""
    half_tangent = np.tan(steering) / 2
    return half_tangent / np.sqrt(1 + half_tangent**2)


def random_drivers(rng, count):
    """The paper's, highway-env's, or any drivers; vehicle 0 is external, a few are constant."""
    style = rng.integers(3)

    def draw(paper, default, low, high):
        return (
            rng.uniform(low, high, count) if style == 2 else np.full(count, (paper, default)[style])
        )

    kind = np.where(rng.random(count) < 0.15, CONSTANT, RULE_BASED).astype(np.int32)
    kind[0] = EXTERNAL
    target = rng.uniform(0.0, 35.0, count)
    unknown = (kind != RULE_BASED) & (rng.random(count) < 0.8)
    exponent = np.full(count, 4.0) if style == 0 else rng.uniform(3.5, 4.5, count)
    return Drivers(
        kind=kind,
        target_speed=np.where(unknown, 0.0, target),
        comfort_acceleration=draw(0.5, 3.0, 0.3, 4.0),
        comfort_deceleration=draw(0.5, 5.0, 0.3, 6.0),
        jam_distance=draw(10.0, 10.0, 0.0, 15.0),
        time_gap=draw(1.5, 1.5, 0.2, 3.0),
        exponent=exponent,
        politeness=draw(0.5, 0.0, 0.0, 1.0),
        minimum_gain=draw(0.2, 0.2, -0.1, 0.5),
        imposed_braking=draw(2.0, 2.0, 0.0, 5.0),
        change_delay=np.ones(count),
        acceleration_limit=draw(1.0, 6.0, 0.5, 8.0),
        slip_limit=slip_sine(draw(np.pi / 36, np.pi / 3, 0.05, 1.2)),
        changes_lanes=rng.random(count) < 0.9,
        checks_collisions=rng.random(count) < 0.8,
        length=np.full(count, 5.0),
        width=np.full(count, 2.0),
    )


def with_linear(rng, drivers):
    """The drivers with about half of those that drive by rules as linear ones, with any gains."""
    count = drivers.kind.shape[0]
    most = {
        "target_speed_gain": 0.6,
        "relative_speed_gain": 0.6,
        "gap_gain": 3.0,
        "heading_gain": 6.0,
        "offset_gain": 10.0,
    }
    gains = {name: rng.uniform(0.0, high, count) for name, high in most.items()}
    applies = (drivers.kind == RULE_BASED) & (rng.random(count) < 0.5)
    return replace(drivers, linear=Linear(applies, **gains))


def random_vehicles(rng, road, count):
    """Vehicles in lanes, between lanes and off the road; ties, near hits, crashes and impacts."""
    lanes = int(road.present.sum())
    lane = rng.integers(0, lanes, count)
    spread = count * rng.choice([3.0, 6.0, 12.0, 25.0]) / lanes * 2
    x = rng.uniform(0.0, spread, count) + rng.choice([0.0, 0.0, -8.0, 150.0])
    twins = rng.random(count) < 0.1
    x = np.where(twins, x[rng.permutation(count)], x)
    aside = np.select(
        [rng.random(count) < p for p in (0.4, 0.5, 0.3, 0.2)],
        [
            0.0,
            rng.normal(0.0, 0.3, count),
            rng.uniform(-3.5, 3.5, count),
            road.width[0] / 2 * np.ones(count),
        ],
        rng.normal(0.0, 1.5, count),
    )
    y = road.centre[lane] + aside
    heading = np.where(rng.random(count) < 0.4, 0.0, rng.normal(0.0, 0.1, count))
    heading = np.where(rng.random(count) < 0.03, rng.uniform(-7.0, 7.0, count), heading)
    speed = rng.uniform(0.0, 30.0, count) if rng.random() < 0.5 else rng.normal(12.0, 3.0, count)
    odd = rng.choice([0.0, -3.0, 0.5, 41.0, -41.0, 1.0, 0.005], count)
    speed = np.where(rng.random(count) < 0.08, odd, speed)
    target = np.where(rng.random(count) < 0.6, lane, rng.integers(0, lanes, count))
    timer = np.where(rng.random(count) < 0.5, rng.uniform(0.0, 2.0, count), rng.choice([0.0, 1.0]))
    steering = rng.choice([-1.0, 0.0, 1.0], count) * np.pi / 50
    impacted = rng.random(count) < 0.03
    return Vehicles(
        present=np.ones(count, bool),
        x=x,
        y=y,
        heading=heading,
        speed=speed,
        slip_sine=slip_sine(steering),
        acceleration=rng.choice([-1.0, 0.0, 1.0], count),
        target_lane=target.astype(np.int32),
        timer=timer,
        crashed=rng.random(count) < 0.05,
        impacted=impacted,
        impact_x=np.where(impacted, rng.normal(0.0, 1.0, count), 0.0),
        impact_y=np.where(impacted, rng.normal(0.0, 0.5, count), 0.0),
    )


def padded(part, size):
    """Extend a struct of [n] arrays to [size]; added vehicles are copies, then marked absent."""
    return jax.tree.map(lambda values: np.resize(values, size), part)


def fit(world, size, lanes_max=LANES_MAX):
    """A world with room for ``size`` vehicles and ``lanes_max`` lanes."""
    count = world.vehicles.x.shape[0]
    vehicles = padded(world.vehicles, size)
    present = vehicles.present & (np.arange(size) < count)
    lanes = world.road.present.shape[0]
    road = padded(world.road, lanes_max)
    road = replace(road, present=road.present & (np.arange(lanes_max) < lanes))
    return World(road, padded(world.drivers, size), replace(vehicles, present=present))


def random_state(rng, linear=False):
    """One random world of 3 to 30 vehicles, padded to the next of `SIZES`."""
    count = int(rng.integers(3, 31))
    road = random_road(rng)
    drivers = random_drivers(rng, count)
    drivers = with_linear(rng, drivers) if linear else drivers
    world = World(road, drivers, random_vehicles(rng, road, count))
    return fit(world, next(size for size in SIZES if size >= count))


def paper_traffic(rng):
    """A start of the paper's trap: an ego behind two slow cars, and traffic ahead."""
    key = jax.random.key(int(rng.integers(2**31)))
    start = jax.device_get(trap.sample(TrapSettings(), key, "training"))

    def wide(values):
        """In 64 bits; what is compared is the same state in both worlds."""
        return values.astype(np.float64) if values.dtype == np.float32 else np.array(values)

    return jax.tree.map(wide, start)
