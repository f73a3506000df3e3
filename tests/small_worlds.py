"""Small worlds in float64 NumPy, by hand or by Hypothesis, and a tick of them in both worlds."""

from dataclasses import fields, replace
from functools import partial

import hypothesis
import jax
import numpy as np
from hypothesis import strategies as st
from parity_states import (
    LANES_MAX,
    fit,
    random_drivers,
    random_road,
    random_vehicles,
    slip_sine,
    with_linear,
)

from lanewise.interop.highway_env import build_env, read_world
from lanewise.world import build, tick
from lanewise.world.settings import PAPER_DRIVER, LinearSettings
from lanewise.world.state import EXTERNAL, RULE_BASED, Drivers, Linear, Road, Vehicles, World

TICK = 0.1
"""Length of a tick, s."""
SIZE = 6
"""Places for vehicles: one shape, so that one compilation serves nearly all tests here."""
NUMBERS = ("x", "y", "heading", "speed", "slip_sine", "acceleration", "timer")
PUSHES = ("impact_x", "impact_y")
DECISIONS = ("target_lane", "crashed", "impacted")
ALL = NUMBERS + PUSHES + DECISIONS


def make_world(
    x, lane, speed=12.5, *, y=None, kinds=None, settings=PAPER_DRIVER, lanes=3, timer=None,
    heading=0.0, size=SIZE,
):  # fmt: skip
    """A world from places; the first vehicle is external unless kinds say otherwise."""
    count, which = len(x), np.arange(lanes)
    x, lane = np.array(x, float), np.array(lane, np.int32)
    y = 4.0 * lane if y is None else np.array(y, float)
    kind = np.array([EXTERNAL] + [RULE_BASED] * (count - 1) if kinds is None else kinds, np.int32)
    settings = settings if isinstance(settings, list) else [settings] * count
    of = {
        name: np.array([getattr(each, name) for each in settings], float)
        for name in (*build.NUMBERS, "changes_lanes")
    }
    linear = np.array([each.model == "linear" for each in settings]) & (kind == RULE_BASED)
    gains = {
        field.name: np.array([getattr(each.linear, field.name) for each in settings], float)
        for field in fields(LinearSettings)
    }
    zeros, no = np.zeros(count), np.zeros(count, bool)
    own_timer = np.mod((x + y) * np.pi, 1.0)
    road = Road(
        present=which >= 0,
        centre=4.0 * which,
        width=np.full(lanes, 4.0),
        start=np.zeros(lanes),
        end=np.full(lanes, 10_000.0),
        speed_limit=np.full(lanes, 30.0),
        open_to_change=which >= 0,
    )
    drivers = Drivers(
        kind=kind,
        target_speed=np.where(kind == RULE_BASED, of.pop("target_speed"), 0.0),
        slip_limit=slip_sine(of.pop("steering_limit")),
        changes_lanes=of.pop("changes_lanes") > 0,
        checks_collisions=~no,
        length=zeros + 5.0,
        width=zeros + 2.0,
        linear=Linear(linear, **gains) if linear.any() else None,
        **of,
    )
    vehicles = Vehicles(
        present=~no,
        x=x,
        y=y,
        heading=zeros + heading,
        speed=zeros + speed,
        target_lane=lane,
        timer=own_timer if timer is None else np.array(timer, float),
        **dict.fromkeys(("slip_sine", "acceleration", "impact_x", "impact_y"), zeros),
        **dict.fromkeys(("crashed", "impacted"), no),
    )
    return fit(World(road, drivers, vehicles), size)


def scattered(rng, count):
    """Vehicles on and between three lanes, some abreast."""
    x, y = rng.uniform(440.0, 560.0, count), rng.uniform(-1.5, 9.5, count)
    lane, kinds = np.clip(np.round(y / 4.0), 0, 2), [0] + [1] * (count - 1)
    speed, heading = rng.uniform(5.0, 15.0, count), rng.uniform(-0.1, 0.1, count)
    return make_world(x, lane, speed, y=y, heading=heading, kinds=kinds, size=8)


# XLA takes subnormal numbers for 0.
floats = partial(st.floats, allow_subnormal=False)
rows = st.tuples(
    st.integers(0, LANES_MAX - 1),
    st.integers(0, 12).map(lambda step: 5.0 * step) | floats(-20, 220),
    st.sampled_from([0.0, 0.0, 2.0, -2.0, 3.0]) | floats(-3.5, 3.5),
    st.just(0.0) | floats(-0.5, 0.5) | st.sampled_from([3.0, -7.0]),
    st.sampled_from([0.0, 0.5, 1.0, 10.0, 12.5, 41.0, -3.0]) | floats(-5, 42),
    st.integers(0, LANES_MAX - 1),
    st.sampled_from([0.0, 0.5, 1.0, 1.5]),
    st.booleans(),
)
"""Lane, x, distance from the lane's centre, heading, speed, target lane, timer, crashed."""


@st.composite
def worlds(draw, linear=False):
    """A world of 1 to `SIZE` vehicles: road and drivers from a seed, vehicles drawn one by one.

    Every other world has the random vehicles of the parity tests instead. Half of the drivers are
    linear ones, or none.
    """
    rng = np.random.default_rng(draw(st.integers(0, 10_000)))
    road = random_road(rng)

    def drivers(count):
        found = random_drivers(rng, count)
        return with_linear(rng, found) if linear else found

    if draw(st.booleans()):
        count = draw(st.integers(2, SIZE))
        return fit(World(road, drivers(count), random_vehicles(rng, road, count)), SIZE)
    drawn = draw(st.lists(rows, min_size=1, max_size=SIZE))
    lane, x, aside, heading, speed, target, timer, crashed = map(np.array, zip(*drawn, strict=True))
    lanes = int(road.present.sum())
    vehicles = replace(
        random_vehicles(rng, road, len(drawn)),
        x=x,
        y=road.centre[lane % lanes] + aside,
        heading=heading,
        speed=speed,
        target_lane=(target % lanes).astype(np.int32),
        timer=timer,
        crashed=crashed & (rng.random(len(drawn)) < 0.3),
    )
    return fit(World(road, drivers(len(drawn)), vehicles), SIZE)


_tick = jax.jit(tick.tick)


def after(world, duration=TICK):
    """The vehicles a tick later, in the numbers of the world."""
    with jax.enable_x64(world.vehicles.x.dtype == np.float64):
        return jax.tree.map(np.array, _tick(world, duration).vehicles)


def both(world, ticks=1, frequency=10):
    """Vehicles after some ticks, ours and highway-env's."""
    env = build_env(world, simulation_frequency=frequency)
    count, ours = len(env.road.vehicles), world
    for _ in range(ticks):
        ours = replace(ours, vehicles=after(ours, 1 / frequency))
        env.road.act()
        env.road.step(1 / frequency)
    return taken(ours.vehicles, slice(count)), read_world(env).vehicles


def change(world, part="vehicles", **values):
    """The world with other values in one of its parts; in the first places, if there are fewer."""
    old, new = getattr(world, part), {}
    for name, value in values.items():
        was = getattr(old, name)
        value = np.broadcast_to(value, np.shape(value) or was.shape).astype(was.dtype)
        new[name] = np.concatenate([value, was[len(value) :]])
    return replace(world, **{part: replace(old, **new)})


def single(world):
    """The world in float32."""
    return jax.tree.map(lambda a: a.astype(np.float32) if a.dtype == np.float64 else a, world)


def shifted(world, along):
    """The world further along the road."""
    road = world.road
    world = change(world, x=world.vehicles.x + along)
    return change(world, "road", start=road.start + along, end=road.end + along)


def mirrored_vehicles(vehicles, lanes):
    """Vehicles with left and right exchanged, on a road of so many lanes."""
    flipped = {name: -getattr(vehicles, name) for name in ("y", "heading", "slip_sine", "impact_y")}
    target = (lanes - 1 - vehicles.target_lane).astype(np.int32)
    return replace(vehicles, target_lane=target, **flipped)


def mirrored(world):
    """The world with left and right exchanged: y to -y, lanes in reverse order."""
    lanes = int(world.road.present.sum())
    order = np.arange(len(world.road.present))
    order[:lanes] = order[:lanes][::-1]
    road = taken(world.road, order)
    road = replace(road, centre=-road.centre)
    return World(road, world.drivers, mirrored_vehicles(world.vehicles, lanes))


def taken(part, order):
    """Drivers, vehicles or lanes in another order."""
    return jax.tree.map(lambda values: values[order], part)


def reordered(world, order):
    """The world with its vehicles in another order."""
    return World(world.road, taken(world.drivers, order), taken(world.vehicles, order))


def lane_distances(world):
    """Distance of every vehicle from every lane, m; infinite from lanes that are absent."""
    road, x, y = world.road, world.vehicles.x[:, None], world.vehicles.y[:, None]
    beyond = np.maximum(x - road.end, 0) + np.maximum(road.start - x, 0)
    return np.where(road.present, np.abs(y - road.centre) + beyond, np.inf)


def assert_same(first, second, where=slice(None), names=ALL, **allowed):
    """Vehicles of two worlds are the same, to the bit but for what is allowed by name."""
    for name in names:
        ours, theirs = getattr(first, name)[where], getattr(second, name)[where]
        bound = allowed.get(name, 0.0)
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=bound, err_msg=name)


def profile(examples):
    """Hypothesis's settings: the same examples in every run."""
    filters = [hypothesis.HealthCheck.filter_too_much, hypothesis.HealthCheck.too_slow]
    return hypothesis.settings(
        derandomize=True, deadline=None, database=None, max_examples=examples,
        suppress_health_check=filters,
    )  # fmt: skip


def check(law, examples, linear=False):
    """Hold a law, a function of a world and a random generator, against many worlds."""

    @profile(examples)
    @hypothesis.given(world=worlds(linear), seed=st.integers(0, 2**32 - 1))
    def holds(world, seed):
        law(world, np.random.default_rng(seed))

    holds()
