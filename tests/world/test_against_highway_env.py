"""Each function against highway-env's own, in float64."""

from dataclasses import fields, replace
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

from lanewise.interop.highway_env import build_env, read_world
from lanewise.world import (
    bicycle,
    build,
    collision,
    driver_model,
    linear,
    mobil,
    motion,
    neighbours,
    observers,
    road,
    steering,
    tick,
)
from lanewise.world.settings import (
    AGGRESSIVE_DRIVER,
    DEFENSIVE_DRIVER,
    LINEAR_DRIVER,
    PAPER_DRIVER,
    DriverSettings,
    LinearSettings,
)
from lanewise.world.state import Drivers
from small_worlds import after, change, fit, make_world, single, taken

pytestmark = pytest.mark.usefixtures("float64")
COUNT, SIDES = 12, (-1, 1)


@jax.jit
def _found(world):
    """What the functions of a tick find for every vehicle."""
    trig = motion.heading_trig(world.vehicles)
    seen = motion.observe(world, trig)
    lanes = seen.lane + jnp.array([0, *SIDES], jnp.int32)[:, None]
    around = neighbours.both(world, seen, observers.all_vehicles(world, seen), lanes)
    own, *sides = (taken(around, which) for which in range(3))
    me = neighbours.as_rear(world, seen)
    boxes = collision.boxes_of(world, trig)
    first, second = (
        collision.Box(*(value.reshape(shape) for value in boxes)) for shape in ((-1, 1), (1, -1))
    )
    return {
        "lane": seen.lane,
        "effort": seen.effort,
        "around": around,
        "acceleration": driver_model.free_road(world.drivers, me)
        - driver_model.following(world.drivers, me, own.front),
        "due": mobil.due(world, seen, 0.1),
        "recommends": [mobil.recommends(world, seen, own, side) for side in sides],
        "gain": [mobil.gain(world, seen, own, side) for side in sides],
        "summed": [mobil.summed_gain(world, seen, own, side) for side in sides],
        "slip": driver_model.keep_lane(world, world.vehicles.target_lane),
        "moved": bicycle.move(bicycle.command(world, 0.7, -0.3), trig, 0.1).vehicles,
        "candidates": collision.candidates(world, boxes, 0.1)[0],
        "overlap": collision.overlap(first, second, 0.1),
    }


def found(world):
    return SimpleNamespace(**jax.device_get(_found(fit(world, COUNT))))


OWN_GAINS = LinearSettings(0.2, 0.5, 1.3, 4.0, 7.0)
DRIVERS = {
    "idm": [PAPER_DRIVER],
    "mixed": [
        *(PAPER_DRIVER, LINEAR_DRIVER, AGGRESSIVE_DRIVER, DEFENSIVE_DRIVER),
        replace(PAPER_DRIVER, model="linear", linear=OWN_GAINS),
    ],
}


@pytest.fixture(scope="module", params=DRIVERS)
def scene(request):
    """Twelve vehicles strewn over three lanes, what our functions find, and their twin."""
    rng, drivers = np.random.default_rng(3), DRIVERS[request.param]
    lane = rng.integers(0, 3, COUNT)
    world = make_world(
        rng.uniform(0, 150, COUNT),
        lane,
        rng.uniform(2, 20, COUNT),
        y=lane * 4.0 + rng.normal(0, 0.8, COUNT),
        heading=rng.normal(0, 0.05, COUNT),
        timer=rng.uniform(0.5, 2, COUNT),
        settings=[drivers[number % len(drivers)] for number in range(COUNT)],
        size=COUNT,
    )
    with jax.enable_x64(True):
        return SimpleNamespace(world=world, found=found(world), env=build_env(world))


def drivers_of(env):
    return [(i, v) for i, v in enumerate(env.road.vehicles) if isinstance(v, IDMVehicle)]


def gain_of(driver, lane_index):
    """The gain of a change as `IDMVehicle.mobil` of highway-env computes it."""
    ahead, behind = driver.road.neighbour_vehicles(driver, lane_index)
    old_ahead, old_behind = driver.road.neighbour_vehicles(driver)
    predict = driver.acceleration
    others = (
        predict(behind, driver) - predict(behind, ahead)
        + predict(old_behind, old_ahead) - predict(old_behind, driver)
    )  # fmt: skip
    return predict(driver, ahead) - predict(driver, old_ahead) + driver.POLITENESS * others


def test_closest_lane():
    network = RoadNetwork.straight_road_network(3, length=100.0)
    places = np.random.default_rng(0).uniform([-20, -5], [120, 15], (500, 2))
    places = np.vstack([places, [[50.0, 2.0], [50.0, 6.0]]])
    lanes = change(make_world([0], [0]), "road", end=100.0).road
    theirs = [network.get_closest_lane_index(place, 0.1)[2] for place in places]
    np.testing.assert_array_equal(jax.jit(road.closest_lane)(lanes, *places.T), theirs)


def test_occupied_and_reachable_lanes():
    places = np.random.default_rng(0).uniform([-10, -5], [110, 15], (500, 2))
    ours = change(make_world([0], [0], lanes=2), "road", end=100.0).road
    occupied = np.array(jax.jit(road.occupied_lanes)(ours, *places.T))
    reachable = np.array(jax.jit(road.reachable_lanes)(ours, *places.T))
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


def test_neighbours():
    """Of equals ahead the last in the list, behind the first."""
    rng = np.random.default_rng(12)
    lane = rng.integers(0, 3, COUNT)
    x = rng.permutation(np.repeat(rng.uniform(0, 200, COUNT // 3), 3))
    speed = np.arange(2.0, 2.0 + COUNT)
    world = make_world(x, lane, speed, y=lane * 4.0 + rng.uniform(-2, 2, COUNT), size=COUNT)
    ours, env = found(world), build_env(world)
    for side, step in enumerate((0, *SIDES)):
        front, rear = ours.around.front, ours.around.rear
        for i, vehicle in enumerate(env.road.vehicles):
            wanted = int(ours.lane[i]) + step
            theirs = (None, None)
            if 0 <= wanted < 3:
                theirs = env.road.neighbour_vehicles(vehicle, ("0", "1", wanted))
            seen = (
                front.velocity_x[side, i] if front.exists[side, i] else None,
                rear.speed[side, i] if rear.exists[side, i] else None,
            )
            assert seen == tuple(other and other.speed for other in theirs)


def test_idm(scene):
    for i, vehicle in drivers_of(scene.env):
        front, _ = scene.env.road.neighbour_vehicles(vehicle)
        theirs = vehicle.acceleration(vehicle, front)
        np.testing.assert_allclose(scene.found.acceleration[i], theirs, rtol=1e-13)


def test_mobil(scene):
    verdicts = set()
    for i, vehicle in drivers_of(scene.env):
        changing = vehicle.lane_index[2] != int(scene.world.vehicles.target_lane[i])
        for side, step in enumerate(SIDES):
            lane = vehicle.lane_index[2] + step
            if 0 <= lane < 3 and not changing:
                theirs = vehicle.mobil(("0", "1", lane))
                assert scene.found.recommends[side][i] == theirs
                verdicts.add(theirs)
    assert verdicts == {True, False}


def test_gains_of_mixed_drivers(scene):
    """Each judges all others by its own model; a plain vehicle is content or wants to stop."""
    for i, driver in drivers_of(scene.env):
        for side, step in enumerate(SIDES):
            lane = int(scene.found.lane[i]) + step
            if 0 <= lane < 3:
                theirs = gain_of(driver, ("0", "1", lane))
                np.testing.assert_allclose(scene.found.summed[side][i], theirs, 1e-9, 1e-9)


def test_without_linear_drivers_nothing_of_them_is_computed(monkeypatch):
    """The program of a tick is the same as if there were no such model."""

    def program(*settings):
        world = make_world([0, 30, 60], [0, 1, 0], settings=[PAPER_DRIVER, *settings])
        return str(jax.make_jaxpr(lambda world: tick.tick(world, 0.1))(world))

    def fail(*_):
        raise AssertionError

    before = program(PAPER_DRIVER, PAPER_DRIVER)
    for name in ("free_road", "interaction", "keep_lane"):
        monkeypatch.setattr(linear, name, fail)
    assert program(PAPER_DRIVER, PAPER_DRIVER) == before
    with pytest.raises(AssertionError):
        program(LINEAR_DRIVER, PAPER_DRIVER)
    # Nor is a plain vehicle linear, whatever its settings.
    none = build.make_drivers([LINEAR_DRIVER, PAPER_DRIVER], [0, 2])
    assert len(jax.tree.leaves(none)) == len(fields(Drivers)) - 2
    world = replace(single(make_world([0, 30], [0, 0], size=2)), drivers=none)
    seen = motion.observe(world, motion.heading_trig(world.vehicles))
    assert seen.shortfall is neighbours.as_front(world, seen).speed is None


@pytest.mark.parametrize("exponent", [2.0, 4.0, 6.0, 20.0])
def test_gains_have_the_rounding_of_highway_env(exponent):
    """In float64 every gain is highway-env's; the exact one is within the stated bound."""
    rng, worst = np.random.default_rng(1), 0.0
    settings = DriverSettings(exponent=exponent, comfort_acceleration=0.7)
    for _ in range(4):
        world = make_world(
            rng.uniform(0, 150, COUNT), rng.integers(0, 3, COUNT), rng.uniform(2, 20, COUNT),
            kinds=[0, *rng.integers(1, 3, COUNT - 1)], settings=settings, size=COUNT,
        )  # fmt: skip
        ours = found(world)
        for i, driver in drivers_of(build_env(world)):
            for side, step in enumerate(SIDES):
                lane = int(ours.lane[i]) + step
                if 0 <= lane < 3:
                    theirs = gain_of(driver, ("0", "1", lane))
                    np.testing.assert_allclose(ours.summed[side][i], theirs, 1e-9, 1e-9)
                    worst = max(worst, abs(float(ours.gain[side][i]) - theirs))
    step = 0.7 * (20 / 0.01) ** exponent * 2.0**-52
    assert worst <= 2.5 * 0.5 * step + 1e-9
    assert (worst > 1e-5) == (exponent >= 4)


def test_steering(scene):
    for i, vehicle in drivers_of(scene.env):
        limit = vehicle.MAX_STEERING_ANGLE
        angle = np.clip(vehicle.steering_control(vehicle.target_lane_index), -limit, limit)
        theirs = np.sin(np.arctan(np.tan(angle) / 2))
        np.testing.assert_allclose(scene.found.slip[i], theirs, atol=1e-15)


def test_the_steering_angle_of_a_slip():
    angles = jnp.linspace(-1.4, 1.4, 57)
    np.testing.assert_allclose(
        steering.from_slip_sine(steering.slip_sine(angles)), angles, rtol=1e-12
    )


def test_outside_the_road_there_is_no_lane():
    assert road.lane_bit(jnp.arange(-2, 4)).tolist() == [0, 0, 1, 2, 4, 8]


def test_who_makes_an_effort_and_who_thinks_of_a_change():
    """Not who reverses; and not who is changing lanes already."""
    world = make_world([0, 50, 100], [0, 0, 0], [-3.0, 10.0, 10.0], timer=[2, 2, 2], size=COUNT)
    ours = found(change(world, target_lane=[0, 1, 0]))
    assert ours.effort[0] == 0.0
    assert ours.due[:3].tolist() == [False, False, True]


def test_a_pair_is_checked_when_either_checks():
    world = make_world([0, 3, 6], [0, 0, 0], size=COUNT)
    for checks, met in (
        ([True, False, False], [0b110, 0b001, 0b001]),
        ([False, True, False], [0b010, 0b101, 0b010]),
        ([False] * 3, [0, 0, 0]),
    ):
        some = change(world, "drivers", checks_collisions=checks)
        assert found(some).candidates[:3].tolist() == met


def test_bicycle(scene):
    moved = scene.found.moved
    ego = build_env(scene.world).road.vehicles[0]
    ego.act({"acceleration": 0.7, "steering": -0.3})
    ego.step(0.1)
    ours = [float(v[0]) for v in (moved.x, moved.y, moved.heading, moved.speed)]
    np.testing.assert_allclose(ours, [*ego.position, ego.heading, ego.speed], rtol=1e-14)


def test_separating_axes_and_the_quick_test_before_them():
    """Crowds with all headings, speeds and sizes: whoever touches is a candidate."""
    rng, met = np.random.default_rng(8), []
    for _ in range(10):
        world = make_world(
            rng.uniform(0, 15, COUNT), [0] * COUNT, rng.normal(0, 20, COUNT), size=COUNT,
            y=rng.uniform(-8, 8, COUNT), heading=rng.normal(0, 1, COUNT) * rng.choice([0.1, 1, 4]),
        )  # fmt: skip
        world = change(world, "drivers", length=rng.uniform(2, 9, COUNT))
        ours, vehicles = found(world), build_env(world).road.vehicles
        candidates = (ours.candidates[:, None] >> np.arange(COUNT)) & 1 == 1
        assert not np.any(np.diag(candidates))
        for i, j in zip(*np.triu_indices(COUNT, 1), strict=True):
            now, soon, way = vehicles[i]._is_colliding(vehicles[j], 0.1)
            overlap = taken(ours.overlap, (i, j))
            assert (bool(overlap.now), bool(overlap.soon)) == (now, soon)
            if soon:
                np.testing.assert_allclose([overlap.x, overlap.y], way, atol=1e-12)
            if now or soon:
                assert candidates[i, j]
                assert candidates[j, i]
            met.append((now, soon))
    assert set(met) == {(False, False), (False, True), (True, True)}


def test_initial_timer():
    lane = RoadNetwork.straight_road_network(3)
    vehicle = IDMVehicle(SimpleNamespace(network=lane), [123.4, 8.0], 0, 10)
    assert float(build.initial_timer(jnp.float64(123.4), jnp.float64(8.0))) == vehicle.timer


def test_reading_what_was_built(scene):
    again = read_world(scene.env)
    for part in ("road", "drivers", "vehicles"):
        ours, theirs = vars(getattr(scene.world, part)), vars(getattr(again, part))
        for name, value in ours.items():
            # Plain vehicles have no driver's parameters to read back, and absent lanes no place.
            kept = slice(0, 3) if part == "road" else slice(1, None)
            if name not in ("changes_lanes", "target_lane"):
                same = partial(np.testing.assert_allclose, atol=1e-15, err_msg=name)
                jax.tree.map(same, taken(value, kept), taken(theirs[name], kept))


def test_ticks_of_batched_worlds_are_those_of_single_ones_one_by_one():
    """Worlds along the first axis or the first two, some of their leaves shared by all."""
    shared = make_world(np.arange(6) * 14.0, [0, 1, 0, 0, 2, 0])
    speeds = np.random.default_rng(0).uniform(5, 20, (2, 3, 6))
    axes = jax.tree.map(lambda _: None, shared)
    axes = replace(axes, vehicles=replace(axes.vehicles, speed=0))
    together = replace(shared, vehicles=replace(shared.vehicles, speed=speeds))
    each = jax.vmap(lambda world: tick.run(world, 0.1, 12).vehicles, in_axes=(axes,))
    batch = jax.device_get(jax.jit(jax.vmap(each, in_axes=(axes,)))(together))
    for place in np.ndindex(2, 3):
        world = change(shared, speed=speeds[place])
        for _ in range(12):
            world = replace(world, vehicles=after(world))
        jax.tree.map(
            partial(np.testing.assert_allclose, atol=1e-9), taken(batch, place), world.vehicles
        )
    assert batch.crashed.any()


def test_added_vehicles_are_absent():
    world = single(make_world([0, 50], [0, 1], size=2))
    ours = build.padded(world, 4)
    assert ours.vehicles.present.tolist() == [True, True, False, False]
    np.testing.assert_array_equal(ours.drivers.kind[:2], world.drivers.kind)
    np.testing.assert_array_equal(ours.vehicles.x[:2], world.vehicles.x)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_arcsine(dtype):
    sines = np.linspace(-steering.SINE_OF_STEEPEST, steering.SINE_OF_STEEPEST, 10_001)
    ours = np.asarray(jax.jit(steering.arcsine)(jnp.asarray(sines.astype(dtype))))
    assert ours.dtype == dtype
    exact = np.arcsin(sines.astype(dtype).astype(np.float64))
    np.testing.assert_allclose(ours, exact, rtol=4 * np.finfo(dtype).eps)
