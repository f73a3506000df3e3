"""Each function against highway-env's own, in float64."""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from highway_env import utils
from highway_env.road.lane import StraightLane
from highway_env.road.road import RoadNetwork
from highway_env.vehicle.behavior import IDMVehicle
from world_views import look, neighbours_on

from lanewise.interop.highway_env import build_env, command_table, read_world
from lanewise.world import (
    bicycle,
    bitset,
    boxes,
    build,
    collision,
    idm,
    mobil,
    motion,
    road,
    steering,
    tick,
)
from lanewise.world.settings import DriverSettings

pytestmark = pytest.mark.usefixtures("float64")
RNG_SEED = 3
run = jax.jit(tick.run, static_argnums=(1, 2))


@pytest.fixture
def scene(make_world):
    """Twelve vehicles strewn over three lanes, ours and highway-env's."""
    rng = np.random.default_rng(RNG_SEED)
    lane = rng.integers(0, 3, 12)
    world = make_world(
        rng.uniform(0, 150, 12),
        lane,
        rng.uniform(2, 20, 12),
        y=lane * 4.0 + rng.normal(0, 0.8, 12),
        heading=rng.normal(0, 0.05, 12),
        timer=rng.uniform(0.5, 2, 12),
    )
    return SimpleNamespace(world=world, env=build_env(world), motion=look(world))


def test_closest_lane():
    network = RoadNetwork.straight_road_network(3, length=100.0)
    places = np.random.default_rng(0).uniform([-20, -5], [120, 15], (500, 2))
    places = np.vstack([places, [[50.0, 2.0], [50.0, 6.0]]])
    ours = road.closest_lane(
        road.straight_road(3, length=100.0, lanes_max=5, dtype=np.float64), *jnp.array(places.T)
    )
    theirs = [network.get_closest_lane_index(place, 0.1)[2] for place in places]
    np.testing.assert_array_equal(ours, theirs)


def test_occupied_and_reachable_lanes():
    places = np.random.default_rng(0).uniform([-10, -5], [110, 15], (500, 2))
    ours = road.straight_road(2, length=100.0, dtype=np.float64)
    occupied = road.occupied_lanes(ours, *jnp.array(places.T))
    reachable = road.reachable_lanes(ours, *jnp.array(places.T))
    for index in range(2):
        lane = StraightLane([0.0, 4.0 * index], [100.0, 4.0 * index])
        on = [lane.on_lane(place, margin=1) for place in places]
        close = [lane.is_reachable_from(place) for place in places]
        np.testing.assert_array_equal((occupied >> index) & 1, on)
        np.testing.assert_array_equal((reachable >> index) & 1, close)


def test_not_zero_and_wrapped():
    values = np.array([-20.0, -np.pi, -0.01, -0.001, 0.0, -0.0, 0.001, 0.01, 0.02, np.pi, 9.0])
    np.testing.assert_array_equal(
        motion.not_zero(jnp.array(values)), [utils.not_zero(v) for v in values]
    )
    wrapped = [utils.wrap_to_pi(v) for v in values]
    np.testing.assert_allclose(steering.wrapped(jnp.array(values)), wrapped, atol=1e-14)


@pytest.mark.parametrize("count", [12, 40])
def test_neighbours(make_world, count):
    rng = np.random.default_rng(count)
    lane = rng.integers(0, 3, count)
    x = rng.permutation(np.repeat(rng.uniform(0, 200, count // 2), 2))
    world = make_world(x, lane, y=lane * 4.0 + rng.uniform(-2, 2, count))
    env = build_env(world)
    seen = look(world)
    everyone = env.road.vehicles
    everywhere = [neighbours_on(world, seen, jnp.full(count, q)) for q in range(3)]
    for q, found in enumerate(everywhere):
        for i, vehicle in enumerate(everyone):
            front, rear = env.road.neighbour_vehicles(vehicle, ("0", "1", q))
            assert bool(found.front.exists[i]) == (front is not None)
            assert bool(found.rear.exists[i]) == (rear is not None)
            if front is not None:
                assert found.front.x[i] == front.position[0]
            if rear is not None:
                assert found.rear.x[i] == rear.position[0]


def test_idm(scene):
    own = neighbours_on(scene.world, scene.motion, scene.motion.lane)
    free = idm.free_road(scene.world.drivers, scene.motion.effort)
    ours = free - idm.following(scene.world, scene.motion, own.front)
    for i, vehicle in enumerate(scene.env.road.vehicles):
        if isinstance(vehicle, IDMVehicle):
            front, _ = scene.env.road.neighbour_vehicles(vehicle)
            np.testing.assert_allclose(ours[i], vehicle.acceleration(vehicle, front), rtol=1e-13)


def test_mobil(scene):
    own = neighbours_on(scene.world, scene.motion, scene.motion.lane)
    verdicts = []
    for step in (-1, 1):
        pair = neighbours_on(scene.world, scene.motion, scene.motion.lane + step)
        ours = mobil.recommends(scene.world, scene.motion, own, pair)
        for i, vehicle in enumerate(scene.env.road.vehicles):
            lane = vehicle.lane_index[2] + step
            changing = step < 0 and vehicle.lane_index[2] != int(
                scene.world.vehicles.target_lane[i]
            )
            if isinstance(vehicle, IDMVehicle) and 0 <= lane < 3 and not changing:
                verdicts.append(vehicle.mobil(("0", "1", lane)))
                assert bool(ours[i]) == verdicts[-1]
    assert True in verdicts
    assert False in verdicts


def test_steering(scene):
    ours = steering.keep_lane(scene.world, scene.world.vehicles.target_lane)
    for i, vehicle in enumerate(scene.env.road.vehicles):
        if isinstance(vehicle, IDMVehicle):
            limit = vehicle.MAX_STEERING_ANGLE
            angle = np.clip(vehicle.steering_control(vehicle.target_lane_index), -limit, limit)
            np.testing.assert_allclose(ours[i], np.sin(np.arctan(np.tan(angle) / 2)), atol=1e-15)


def test_the_steering_angle_of_a_slip():
    angles = jnp.linspace(-1.4, 1.4, 57)
    np.testing.assert_allclose(
        steering.from_slip_sine(steering.slip_sine(angles)), angles, rtol=1e-12
    )


def test_outside_the_road_there_is_no_lane():
    assert road.lane_bit(jnp.arange(-2, 4)).tolist() == [0, 0, 1, 2, 4, 8]


def test_a_reversing_vehicle_makes_no_effort(make_world):
    assert look(make_world([0, 50], [0, 0], [-3.0, 10.0])).effort.tolist()[0] == 0.0


def test_who_changes_lanes_does_not_think_of_another_change(make_world):
    world = make_world([0, 50, 100], [0, 0, 0], timer=[2, 2, 2])
    targets = jnp.array([0, 1, 0], jnp.int32)
    world = replace(world, vehicles=replace(world.vehicles, target_lane=targets))
    assert mobil.due(world, look(world), 0.1).tolist() == [False, False, True]


def test_a_pair_is_checked_when_either_checks(make_world):
    world = make_world([0, 3, 6], [0, 0, 0])
    for checks, met in (
        ([True, False, False], [0b110, 0b001, 0b001]),
        ([False, True, False], [0b010, 0b101, 0b010]),
        ([False] * 3, [0, 0, 0]),
    ):
        drivers = replace(world.drivers, checks_collisions=jnp.array(checks))
        some = replace(world, drivers=drivers)
        everyone = boxes.of_vehicles(some, motion.heading_trig(some.vehicles))
        assert collision.candidates(some, everyone, 0.1)[0].tolist() == met


def test_bicycle(scene):
    world = bicycle.command(scene.world, 0.7, -0.3)
    moved = bicycle.move(world, motion.heading_trig(world.vehicles), 0.1).vehicles
    ego = scene.env.road.vehicles[0]
    ego.act({"acceleration": 0.7, "steering": -0.3})
    ego.step(0.1)
    ours = [float(v[0]) for v in (moved.x, moved.y, moved.heading, moved.speed)]
    np.testing.assert_allclose(ours, [*ego.position, ego.heading, ego.speed], rtol=1e-14)


def test_separating_axes(make_world):
    rng = np.random.default_rng(5)
    met = set()

    @jax.jit
    def of_the_first_two(world):
        everyone = boxes.of_vehicles(world, motion.heading_trig(world.vehicles))
        mine, theirs = (boxes.Box(*(value[i] for value in everyone)) for i in range(2))
        return boxes.overlap(mine, theirs, 0.1)

    for _ in range(300):
        world = make_world(
            rng.uniform(0, 7, 2), [0, 0], rng.uniform(-5, 30, 2), y=rng.uniform(-2, 2, 2),
            heading=rng.normal(0, 0.5, 2),
        )  # fmt: skip
        a, b = build_env(world).road.vehicles
        now, soon, way = a._is_colliding(b, 0.1)
        ours = of_the_first_two(world)
        assert (bool(ours.now), bool(ours.soon)) == (now, soon)
        if soon:
            np.testing.assert_allclose([ours.x, ours.y], way, atol=1e-12)
        met.add((now, soon))
    assert met == {(False, False), (False, True), (True, True)}


def test_initial_timer():
    lane = RoadNetwork.straight_road_network(3)
    vehicle = IDMVehicle(SimpleNamespace(network=lane), [123.4, 8.0], 0, 10)
    assert float(build.initial_timer(123.4, 8.0)) == vehicle.timer


def test_reading_what_was_built(scene):
    again = read_world(scene.env)
    for part in ("road", "drivers", "vehicles"):
        ours, theirs = vars(getattr(scene.world, part)), vars(getattr(again, part))
        for name, value in ours.items():
            # Plain vehicles have no driver's parameters to read back.
            if name not in ("timer", "changes_lanes") and value.shape == (12,):
                value, theirs[name] = value[1:], theirs[name][1:]
            if name not in ("timer", "changes_lanes", "target_lane"):
                np.testing.assert_allclose(value, theirs[name], atol=1e-15, err_msg=name)


def test_command_table_is_in_the_order_of_highway_env(scene):
    table = command_table(scene.env)
    assert table.shape == (9, 2)
    for action, (acceleration, angle) in enumerate(table):
        assert acceleration == (action // 3) - 1
        np.testing.assert_allclose(angle, (action % 3 - 1) * np.pi / 50, rtol=1e-7)


def test_many_ticks_equal_one_by_one(scene):
    together = run(scene.world, 0.1, 3)
    world = scene.world
    one = jax.jit(tick.tick)
    for _ in range(3):
        world = one(world, 0.1)
    np.testing.assert_allclose(together.vehicles.x, world.vehicles.x, rtol=1e-14)


def test_batched_worlds_are_the_single_ones(make_world):
    """Worlds along the first axis or the first two, some of their leaves shared by all."""
    rng = np.random.default_rng(0)
    lane = rng.integers(0, 3, 10)
    speeds = rng.uniform(5, 20, (2, 3, 10))
    worlds = [[make_world(np.arange(10) * 14.0, lane, speed) for speed in row] for row in speeds]
    singles = [[run(world, 0.1, 40) for world in row] for row in worlds]
    assert any(bool(world.vehicles.crashed.any()) for row in singles for world in row)
    shared = worlds[0][0]
    axes = jax.tree.map(lambda _: None, shared)
    axes = replace(axes, vehicles=replace(axes.vehicles, speed=0))
    together = replace(shared, vehicles=replace(shared.vehicles, speed=jnp.array(speeds)))
    each = jax.vmap(lambda world: run(world, 0.1, 40), in_axes=(axes,))
    found = jax.jit(jax.vmap(each, in_axes=(axes,)))(together).vehicles
    for row, column in np.ndindex(2, 3):
        mine = jax.tree.map(lambda leaf, at=(row, column): leaf[at], found)
        jax.tree.map(
            partial(np.testing.assert_allclose, atol=1e-9), mine, singles[row][column].vehicles
        )


@pytest.mark.parametrize("count", [1, 31, 32, 33, 64, 70])
def test_sets_across_words(count):
    rng = np.random.default_rng(count)
    inside = rng.random((20, count)) < 0.1
    words = bitset.where(count, lambda member: jnp.array(inside[:, member]))
    for row, low in enumerate(bitset.smallest(words).tolist()):
        members = np.flatnonzero(inside[row])
        assert low == (members[0] if members.size else -1)
    limit = jnp.arange(count + 1)
    left = bitset.without(bitset.where(count, lambda _: limit >= 0), bitset.below(limit, count))
    # What is not below a limit begins with it.
    np.testing.assert_array_equal(bitset.smallest(left), np.where(limit < count, limit, -1))
    above = bitset.both(bitset.below(limit, count), bitset.single(jnp.maximum(limit - 1, 0), count))
    np.testing.assert_array_equal(bitset.smallest(above), limit - 1)
    single = bitset.single(limit[:-1], count)
    np.testing.assert_array_equal(bitset.smallest(single), limit[:-1])


def test_settings_reach_the_driver():
    drivers = build.make_drivers([DriverSettings(time_gap=0.9)], [2], 3, np.float64)
    assert drivers.time_gap.tolist() == [0.9] * 3


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_arcsine(dtype):
    sines = np.linspace(-steering.SINE_OF_STEEPEST, steering.SINE_OF_STEEPEST, 10_001)
    ours = np.asarray(steering.arcsine(jnp.asarray(sines.astype(dtype))))
    assert ours.dtype == dtype
    exact = np.arcsin(sines.astype(dtype).astype(np.float64))
    np.testing.assert_allclose(ours, exact, rtol=4 * np.finfo(dtype).eps)


def test_the_quick_test_of_collisions_never_misses_a_pair(make_world):
    """Crowded worlds with all headings, speeds and sizes: whoever touches is a candidate."""
    rng = np.random.default_rng(8)
    count, touching = 12, 0

    @jax.jit
    def quick_and_exact(world):
        everyone = boxes.of_vehicles(world, motion.heading_trig(world.vehicles))
        a, b = (boxes.Box(*(value.reshape(shape) for value in everyone)) for shape in PAIRS)
        return collision.candidates(world, everyone, 0.1)[0], boxes.overlap(a, b, 0.1)

    for _ in range(100):
        world = make_world(
            rng.uniform(0, 15, count), [0] * count, rng.normal(0, 20, count),
            y=rng.uniform(-8, 8, count), heading=rng.normal(0, 1, count) * rng.choice([0.1, 1, 4]),
        )  # fmt: skip
        world = replace(world, drivers=replace(world.drivers, length=rng.uniform(2, 9, count)))
        found, exact = jax.device_get(quick_and_exact(world))
        met = (found[:, None] >> np.arange(count)) & 1 == 1
        touches = np.triu(exact.now | exact.soon, 1)
        touching += touches.sum()
        assert np.all(met | ~(touches | touches.T))
        assert not np.any(np.diag(met))
    assert touching > 1000


PAIRS = ((-1, 1), (1, -1))
"""Shapes that set everyone against everyone."""
