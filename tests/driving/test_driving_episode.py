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
JUDGE = jax.jit(partial(episode.judge, DRIVING), static_argnums=3)
STEP = jax.jit(partial(episode.step, DRIVING), static_argnums=2)


def trap_world(ego_x, ego_y=8.0, ego_speed=15.0):
    """The ego in the right lane, the trap cars in the two others."""
    return world_of([ego_x, 100.0, 92.0], [ego_y, 0.0, 4.0], [ego_speed, 10.0, 10.0])


def step(state, action=actions.IDLE, duration=50):
    return STEP(state, jnp.int32(action), duration)


def test_truncation_comes_with_the_last_decision_and_not_before():
    state = episode.begin(trap_world(0.0))
    for decision in range(1, 5):
        state, outcome = step(state, duration=4)
        assert int(state.decisions) == decision
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
        _, outcome = JUDGE(episode.begin(after), after, jnp.float32(0.0), 50)
        expected = (1.5 * 0.2 + 0.05 - 0.05 * sin(steered)) / 1.6
        assert float(outcome.reward) == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize(("ego_x", "escaped"), [(104.9, False), (105.1, True)])
def test_escape_needs_the_rear_bumper_past_the_front_of_the_foremost_trap_car(ego_x, escaped):
    """Both are 5 m long, so the centres must be more than 5 m apart."""
    before = episode.begin(trap_world(ego_x))
    after, _ = JUDGE(before, before.world, jnp.float32(0.0), 50)
    assert bool(after.escaped) == escaped


def test_escape_stays_true_when_the_trap_cars_catch_up():
    passed = replace(episode.begin(trap_world(0.0)), escaped=jnp.bool_(True))
    after, _ = step(passed)
    assert after.escaped


def test_an_escape_in_the_decision_of_an_accident_does_not_count():
    before = episode.begin(trap_world(120.0))
    wreck = before.world
    vehicles = replace(wreck.vehicles, crashed=wreck.vehicles.crashed.at[0].set(True))
    after, outcome = JUDGE(before, replace(wreck, vehicles=vehicles), jnp.float32(0.0), 50)
    assert outcome.terminated
    assert not after.escaped


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
    state, outcome = STEP(episode.begin(trap_world(0.0)), jnp.int32(actions.IDLE), 50)
    ends = [
        number
        for number in range(1, driving.decisions_in(25) + 1)
        if episode.ends_timestep(driving, replace(state, decisions=jnp.int32(number)), outcome)
    ]
    times = [number * driving.decision_duration for number in ends]
    assert [int(time + 1e-9) for time in times] == list(range(1, 26))
    assert all(time % 1.0 < driving.decision_duration - 1e-9 for time in times)
