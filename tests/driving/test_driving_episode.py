from dataclasses import replace
from functools import partial
from math import sin

import jax
import jax.numpy as jnp
import pytest
from driving_worlds import world_of

from lanewise.driving import accidents, actions, episode
from lanewise.driving.settings import DrivingSettings
from lanewise.world.state import RULE_BASED
from lanewise.world.steering import slip_sine

DRIVING = DrivingSettings()
EVALUATE = jax.jit(partial(episode.evaluate_step, DRIVING), static_argnums=3)
STEP = jax.jit(partial(episode.step, DRIVING), static_argnums=2)


def trap_world(ego_x, ego_y=8.0, ego_speed=15.0):
    """The ego in the right lane, the trap cars in the two others."""
    return world_of([ego_x, 100.0, 92.0], [ego_y, 0.0, 4.0], [ego_speed, 10.0, 10.0])


def step(state, action=actions.IDLE, duration=50):
    after = STEP(state, jnp.int32(action), duration)
    return after, after.outcome


def test_truncation_comes_with_the_last_decision_and_not_before():
    state = episode.begin(trap_world(0.0))
    for decision in range(1, 5):
        state, outcome = step(state, duration=4)
        assert int(state.stats.decisions) == decision
        assert bool(outcome.truncated) == (decision == 4)
        assert not outcome.terminated


def test_an_accident_terminates_and_is_no_truncation_even_at_the_last_decision():
    state = episode.begin(trap_world(0.0, ego_y=9.9))
    state, outcome = step(state, action=int(actions.index(jnp.int32(0), jnp.int32(1))), duration=1)
    assert int(outcome.accident) == accidents.OFF_ROAD
    assert outcome.terminated
    assert not outcome.truncated
    assert float(outcome.reward) == -10.0


def test_a_collision_terminates():
    state = episode.begin(world_of([0.0, 6.0, 60.0], [4.0, 4.0, 4.0], [15.0, 5.0, 5.0]))
    state, outcome = step(state)
    assert int(outcome.accident) == accidents.COLLISION
    assert outcome.terminated


def test_coming_to_a_stop_terminates():
    state = episode.begin(trap_world(0.0, ego_speed=0.4))
    _, outcome = step(state, action=int(actions.index(jnp.int32(-1), jnp.int32(0))))
    assert int(outcome.accident) == accidents.STOPPED


def test_a_decision_lasts_half_a_second_of_ten_ticks_a_second():
    state, _ = step(episode.begin(trap_world(0.0, ego_speed=12.0)))
    assert float(state.world.vehicles.x[0]) == pytest.approx(6.0, abs=1e-4)
    assert DRIVING.ticks_per_decision == 5


def test_reward_is_of_the_state_after_the_decision():
    accelerate = int(actions.index(jnp.int32(1), jnp.int32(0)))
    _, outcome = step(episode.begin(trap_world(0.0, ego_speed=12.5)), action=accelerate)
    assert float(outcome.reward) == pytest.approx(
        (1.5 * (8 / 25 * 13.0 - 19 / 5) + 0.05) / 1.6, abs=1e-5
    )


def test_what_a_rule_based_ego_steers_costs():
    world = trap_world(0.0, ego_speed=12.5)
    kind = world.drivers.kind.at[0].set(RULE_BASED)
    slip = world.vehicles.slip_sine.at[0].set(slip_sine(jnp.float32(0.3)))
    for kinds, steered in ((world.drivers.kind, 0.0), (kind, 0.3)):
        drivers = replace(world.drivers, kind=kinds)
        after = replace(world, drivers=drivers, vehicles=replace(world.vehicles, slip_sine=slip))
        outcome = EVALUATE(episode.begin(after), after, jnp.float32(0.0), 50).outcome
        expected = (1.5 * 0.2 + 0.05 - 0.05 * sin(steered)) / 1.6
        assert float(outcome.reward) == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize(("ego_x", "escaped"), [(104.9, False), (105.1, True)])
def test_escape_needs_the_rear_bumper_past_the_front_of_the_foremost_trap_car(ego_x, escaped):
    """Both are 5 m long, so the centres must be more than 5 m apart."""
    before = episode.begin(trap_world(ego_x))
    after = EVALUATE(before, before.world, jnp.float32(0.0), 50)
    assert bool(after.stats.escaped) == escaped


def test_escape_stays_true_when_the_trap_cars_catch_up():
    begun = episode.begin(trap_world(0.0))
    passed = replace(begun, stats=replace(begun.stats, escape_decision=jnp.int32(1)))
    after, _ = step(passed)
    assert after.stats.escaped


def test_an_escape_in_the_decision_of_an_accident_does_not_count():
    before = episode.begin(trap_world(120.0))
    wreck = before.world
    vehicles = replace(wreck.vehicles, crashed=wreck.vehicles.crashed.at[0].set(True))
    after = EVALUATE(before, replace(wreck, vehicles=vehicles), jnp.float32(0.0), 50)
    assert after.outcome.terminated
    assert not after.stats.escaped


@pytest.mark.parametrize(
    ("seconds", "simulation", "decision", "expected"),
    [
        (25, 10, 2, 50),
        (25.0, 15, 2, 54),  # decisions of 7/15 s
        (7 / 15, 15, 2, 1),
        (25.2, 15, 2, 54),
        (25.3, 15, 2, 55),
        (1.0, 10, 10, 10),
        (0.3, 10, 10, 3),
        (0.25, 10, 2, 1),
        (100_000, 100, 50, 5_000_000),
    ],
)
def test_seconds_are_simulated_ones_rounded_up_to_decisions(
    seconds, simulation, decision, expected
):
    driving = DrivingSettings(simulation_frequency=simulation, decision_frequency=decision)
    assert driving.decisions_in(seconds) == expected


@pytest.mark.parametrize("frequencies", [(10, 2), (15, 2), (30, 16), (10, 1)])
def test_one_reward_counts_in_each_simulated_second(frequencies):
    driving = DrivingSettings(*frequencies)
    state = episode.begin(trap_world(0.0))
    evaluate = jax.jit(partial(episode.evaluate_step, driving), static_argnums=3)
    ends = []
    for number in range(1, driving.decisions_in(25) + 1):
        stats = replace(state.stats, decisions=jnp.int32(number - 1))
        after = evaluate(replace(state, stats=stats), state.world, jnp.float32(0.0), 999)
        if after.stats.timestep_reward != 0.0:
            assert after.stats.timestep_reward == after.outcome.reward
            ends.append(number)
    times = [number * driving.decision_duration for number in ends]
    assert [int(time + 1e-9) for time in times] == list(range(1, 26))
    assert all(time % 1.0 < driving.decision_duration - 1e-9 for time in times)


def test_an_escape_counts_from_its_first_decision_and_an_accident_takes_success_away():
    """0.5 s decisions behind nobody: the reward of every second decision counts."""
    state = episode.begin(trap_world(106.0, ego_speed=10.0))
    rewards, speeds = [], []
    for decision in range(1, 5):
        world = state.world
        if decision == 4:
            crashed = world.vehicles.crashed.at[0].set(True)
            world = replace(world, vehicles=replace(world.vehicles, crashed=crashed))
        state = EVALUATE(state, world, jnp.float32(0.0), 50)
        rewards.append(float(state.outcome.reward))
        speeds.append(float(world.vehicles.speed[0]))
        assert bool(state.stats.success) == (decision < 4)
        assert int(state.stats.escape_decision) == 1
    assert rewards[-1] == -10.0
    assert float(state.stats.reward) == pytest.approx(sum(rewards))
    assert float(state.stats.timestep_reward) == pytest.approx(rewards[1] + rewards[3])
    assert float(state.stats.speed_sum) == pytest.approx(sum(speeds))
