"""Who drives the traffic: populations against their sources, and speeds that swing."""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from highway_env.vehicle.behavior import IDMVehicle

from lanewise import config
from lanewise.driving import episode, percept
from lanewise.driving.settings import DrivingSettings, ObservationSettings
from lanewise.driving.task_functions import TaskFunctions
from lanewise.envs import functional
from lanewise.errors import SettingsError
from lanewise.interop.highway_env import build_env
from lanewise.scenario import drivers, trap
from lanewise.scenario.populations import POPULATIONS
from lanewise.scenario.settings import TrafficSettings, TrapSettings
from lanewise.world import bicycle, build, steering, tick
from lanewise.world.settings import (
    AGGRESSIVE_DRIVER,
    HIGHWAY_ENV_DRIVER,
    PAPER_DRIVER,
    DriverSettings,
)
from lanewise.world.state import CONSTANT, RULE_BASED

COUNT, SPEED = 4000, 14.0
NAMES = build.NUMBERS


def among(*names):
    return TrapSettings(traffic=TrafficSettings(populations=names))


@partial(jax.jit, static_argnums=0)
def traffic(settings, seed=3):
    return drivers.of_traffic(settings, jax.random.key(seed), COUNT, SPEED)


@pytest.mark.parametrize("name", POPULATIONS)
def test_each_vehicle_s_numbers_fill_the_ranges_of_its_population(name):
    population, found = POPULATIONS[name], traffic(among(name))
    target = found.target_speed / SPEED
    wanted = {field: (getattr(population.driver, field),) * 2 for field in NAMES}
    wanted |= population.ranges | {"target_speed": population.desired_speed}
    drawn = {field: getattr(found, field, None) for field in NAMES} | {"target_speed": target}
    drawn["steering_limit"] = steering.from_slip_sine(found.slip_limit)
    for field, (low, high) in wanted.items():
        near = 0.01 * (high - low) + 1e-5
        assert low - 1e-5 <= drawn[field].min() <= low + near, field
        assert high - near <= drawn[field].max() <= high + 1e-5, field
        # What is drawn could be set by hand.
        for limit in (low, high):
            bound = config.field_types(DriverSettings)[field]
            bound.check(field, limit)
    assert (found.waves is not None) == population.waves


def test_the_paper_s_population_is_the_paper_s_drivers():
    ours, plain = traffic(among("paper")), traffic(TrapSettings())
    for name in ("target_speed", "slip_limit", "changes_lanes", "time_gap", "politeness"):
        wanted = SPEED if name == "target_speed" else getattr(plain, name)
        np.testing.assert_array_equal(getattr(ours, name), wanted)


def test_highway_env_s_population_is_its_class():
    population = POPULATIONS["highway-env"]
    assert population.driver is HIGHWAY_ENV_DRIVER
    assert population.ranges["exponent"] == tuple(IDMVehicle.DELTA_RANGE)


def test_all_populations_are_equally_likely():
    found = traffic(among("paper", "timid", "cutting-in"))
    shares = [np.mean(found.politeness == 0.5), np.mean(found.politeness > 0.6)]
    np.testing.assert_allclose(shares, 1 / 3, atol=0.03)


@pytest.mark.parametrize("names", [("paper",), tuple(POPULATIONS)], ids=["paper", "all"])
def test_a_vehicle_of_a_population_has_nothing_of_the_scenario_s_driver(names):
    numbers = {name: getattr(PAPER_DRIVER, name) + 0.1 for name in NAMES}
    driver = replace(AGGRESSIVE_DRIVER, changes_lanes=False, **numbers)
    other = TrapSettings(traffic=TrafficSettings(driver=driver, populations=names))
    jax.tree.map(np.testing.assert_array_equal, traffic(among(*names)), traffic(other))


SWINGING = replace(
    among("stop-and-go"), trap_speed_difference=1.0, trap_speed_wave=3.0, trap_wave_period=12.0
)
DRIVING = DrivingSettings()


@partial(jax.jit, static_argnums=(0, 1))
def drive(settings, decisions):
    world = trap.sample(settings, trap.start_key(5, "test", 0), "test")
    state = episode.begin(world)

    def decide(state, _):
        state = episode.step(DRIVING, state, jnp.int32(4), decisions)
        return state, state.world

    return world, jax.lax.scan(decide, state, length=decisions)[1]


def test_speeds_follow_their_waves():
    """After t seconds a trap car has v + A sin(2 pi (t / T + phase)), each with its own phase."""
    begin, world = jax.device_get(drive(SWINGING, 60))
    time = np.arange(0.0, 30.5, 0.5)[:, None]
    waves = begin.drivers.waves
    mean, phase = np.array([10.0, 11.0]), waves.phase[1:3]
    speed = np.concatenate([begin.vehicles.speed[None], world.vehicles.speed])
    wanted = mean + 3.0 * np.sin(2 * np.pi * (time / 12.0 + phase))
    np.testing.assert_allclose(speed[:, 1:3], wanted, atol=1e-4)
    assert abs(phase[0] - phase[1]) > 0.01
    desired = world.drivers.target_speed[:, 3:]
    wanted = waves.mean[3:] + waves.amplitude[3:] * np.sin(
        2 * np.pi * (time[:-1] / waves.period[3:] + waves.phase[3:])
    )
    np.testing.assert_allclose(desired, wanted, atol=1e-4)
    assert (world.drivers.kind[:, 1:3] == CONSTANT).all()
    assert (world.drivers.target_speed[:, :3] == 0).all()


def test_highway_env_has_no_waves():
    world = trap.sample(SWINGING, trap.start_key(0, "test", 0), "test")
    with pytest.raises(SettingsError, match="whose speed swings"):
        build_env(world)


@pytest.mark.parametrize(("count", "names"), [(0, ()), (2, ()), (2, ("paper",))])
def test_an_ego_of_a_linear_class_drives_by_its_rules(count, names):
    """Alone, among its like, and among traffic that is not linear."""
    among_these = TrafficSettings(vehicles_ahead=count, driver=AGGRESSIVE_DRIVER, populations=names)
    begin, world = drive(TrapSettings(ego_driver="rule-based", traffic=among_these), 4)
    assert begin.drivers.kind.tolist() == [RULE_BASED, CONSTANT, CONSTANT] + [RULE_BASED] * count
    assert begin.drivers.linear.applies.tolist() == [True, False, False] + [not names] * count
    # Too near the trap car ahead it brakes, though its action is to keep the speed.
    assert world.vehicles.speed[0, 0] < 9.9
    assert np.isfinite(world.vehicles.x).all()


def hurried(settings, key, split):
    """The paper's start, with an ego that is faster than the trap."""
    world = trap.sample(settings, key, split)
    speed = world.vehicles.speed.at[0].set(11.0)
    return replace(world, vehicles=replace(world.vehicles, speed=speed))


@pytest.mark.parametrize(("name", "part"), [("aggressive", "linear"), ("stop-and-go", "waves")])
def test_a_start_of_one_s_own_may_have_any_population(name, part):
    config = functional.make(
        task=TaskFunctions(start=hurried), populations=[name], vehicles_ahead=2
    )
    state, _ = functional.reset(config, jax.random.key(0))
    state, shown = functional.step(config, state, 4)
    assert getattr(state.episode.world.drivers, part) is not None
    assert shown.speed == 11.0
    assert np.isfinite(shown.observation).all()


@pytest.mark.parametrize("late", [1, 4])
def test_a_decision_takes_effect_after_the_latency(late):
    settings = DrivingSettings(latency=late / 10)
    state = episode.begin(trap.sample(TrapSettings(), trap.start_key(1, "test", 0), "test"))
    after = jax.jit(partial(episode.step, settings, duration=50))(state, jnp.int32(8))
    world = tick.run(state.world, 0.1, late)
    world = tick.run(bicycle.command(world, 1.0, np.pi / 50), 0.1, 5 - late)
    np.testing.assert_allclose(after.world.vehicles.x, world.vehicles.x, rtol=1e-6)
    assert after.world.vehicles.speed[0] == pytest.approx(10.0 + 0.1 * (5 - late))


def test_in_training_the_latency_is_drawn_anew_for_each_decision():
    """Ego speeds after one decision tell how many of its five ticks accelerated."""
    settings = DrivingSettings(training_latency=(0.1, 0.3))
    worlds = jax.vmap(
        lambda i: trap.sample(TrapSettings(), trap.start_key(1, "training", i), "training")
    )(jnp.arange(600))
    after = jax.jit(
        jax.vmap(
            lambda world: (
                episode.step(settings, episode.begin(world), jnp.int32(8), 50, training=True).world
            )
        )
    )(worlds)
    late = 5 - np.rint((np.asarray(after.vehicles.speed[:, 0]) - 10.0) * 10).astype(int)
    np.testing.assert_allclose(np.bincount(late) / 600, [0, 1 / 3, 1 / 3, 1 / 3], atol=0.07)


def features(settings, worlds, training=False):
    perceive = partial(percept.perceive, settings, training=training)
    return jax.jit(jax.vmap(lambda world: perceive(world).features))(worlds)


def test_noise_is_normal_the_same_for_the_same_world_and_new_after_a_tick():
    clean, noisy = (ObservationSettings(noise=size) for size in (0.0, 0.1))
    _, worlds = drive(TrapSettings(), 50)
    seen, plain = features(noisy, worlds), features(clean, worlds)
    np.testing.assert_array_equal(seen, features(noisy, worlds))
    later = jax.jit(jax.vmap(lambda world: tick.run(world, 0.1, 1)))(worlds)
    error = np.concatenate([seen - plain, features(noisy, later) - features(clean, later)])
    assert error.std() == pytest.approx(0.1, rel=0.05)
    assert abs(error.mean()) < 0.01
    alike = np.corrcoef(error)[np.triu_indices(100, 1)]
    # Independent of one another, 26 normal numbers each: one in 10^9 pairs is above 0.9.
    assert np.abs(alike).max() < 0.9
    assert np.mean(alike**2) == pytest.approx(1 / 25, rel=0.15)
    varied = ObservationSettings(training_noise=(0.0, 0.2))
    sizes = np.asarray(features(varied, worlds, training=True) - plain).std(axis=1)
    assert sizes.min() < 0.03
    assert 0.15 < sizes.max() < 0.3
    assert sizes.mean() == pytest.approx(0.1, abs=0.02)


def test_noise_does_not_depend_on_room_for_vehicles_that_are_absent():
    few = TrapSettings(traffic=TrafficSettings(vehicles_ahead=2))
    world = jax.jit(partial(trap.sample, few, split="test"))(trap.start_key(5, "test", 0))
    there = world.vehicles.present.at[-1].set(False)
    absent = replace(world, vehicles=replace(world.vehicles, present=there))
    fewer = replace(
        absent,
        drivers=jax.tree.map(lambda leaf: leaf[:-1], absent.drivers),
        vehicles=jax.tree.map(lambda leaf: leaf[:-1], absent.vehicles),
    )
    perceive = jax.jit(partial(percept.perceive, ObservationSettings(noise=0.1)))
    np.testing.assert_array_equal(perceive(absent).features, perceive(fewer).features)
