from dataclasses import replace
from functools import partial
from math import sin

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from parity_states import slip_sine

from lanewise.driving import accidents, actions, episode
from lanewise.driving.settings import DrivingSettings
from lanewise.scenario import trap
from lanewise.scenario.settings import TrapSettings
from lanewise.world.state import RULE_BASED
from small_worlds import change, make_world, single, taken

DRIVING = DrivingSettings()
EVALUATE = jax.jit(partial(episode.evaluate_step, DRIVING))
STEP = jax.jit(partial(episode.step, DRIVING))


def world_of(x, lane, speed):
    """The ego and cars at constant speed."""
    return single(make_world(x, lane, speed, kinds=[0, 1, 1]))


def trap_world(ego_x, ego_speed=15.0, **changed):
    """The ego in the right lane, the trap cars in the two others."""
    return change(world_of([ego_x, 100.0, 92.0], [2, 0, 1], [ego_speed, 10.0, 10.0]), **changed)


def step(state, acceleration=0, steering=0, duration=50):
    action = actions.index(np.int32(acceleration), np.int32(steering))
    after = STEP(state, action, duration)
    return after, after.outcome


def test_truncation_comes_with_the_last_decision_and_not_before():
    state = episode.begin(trap_world(0.0))
    for decision in range(1, 5):
        state, outcome = step(state, duration=4)
        assert int(state.stats.decisions) == decision
        assert bool(outcome.truncated) == (decision == 4)
        assert not outcome.terminated


@pytest.mark.parametrize(
    ("world", "action", "accident"),
    [
        (trap_world(0.0, y=[9.9]), (0, 1), accidents.OFF_ROAD),
        (world_of([0.0, 6.0, 60.0], [1, 1, 1], [15.0, 5.0, 5.0]), (0, 0), accidents.COLLISION),
        (trap_world(0.0, ego_speed=0.4), (-1, 0), accidents.STOPPED),
    ],
)
def test_an_accident_terminates_and_is_no_truncation_even_at_the_last_decision(
    world, action, accident
):
    _, outcome = step(episode.begin(world), *action, duration=1)
    assert int(outcome.accident) == accident
    assert outcome.terminated
    assert not outcome.truncated
    assert float(outcome.reward) == -10.0


def test_a_decision_lasts_half_a_second_and_its_reward_is_of_the_state_after_it():
    state, outcome = step(episode.begin(trap_world(0.0, ego_speed=12.5)), acceleration=1)
    assert DRIVING.ticks_per_decision == 5
    speeds = 12.5 + 0.1 * np.arange(5)
    assert float(state.world.vehicles.x[0]) == pytest.approx(sum(speeds) / 10, abs=1e-4)
    expected = (1.5 * (8 / 25 * 13.0 - 19 / 5) + 0.05) / 1.6
    assert float(outcome.reward) == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize(("kind", "steered"), [(0, 0.0), (RULE_BASED, 0.3)])
def test_what_a_rule_based_ego_steers_costs(kind, steered):
    world = trap_world(0.0, ego_speed=12.5, slip_sine=[slip_sine(0.3)])
    after = change(world, "drivers", kind=[kind])
    outcome = EVALUATE(episode.begin(after), after, jnp.float32(0.0), 50).outcome
    expected = (1.5 * 0.2 + 0.05 - 0.05 * sin(steered)) / 1.6
    assert float(outcome.reward) == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize(("ego_x", "escaped"), [(104.9, False), (105.1, True)])
def test_escape_needs_the_rear_bumper_past_the_front_of_the_foremost_trap_car(ego_x, escaped):
    """Both are 5 m long, so the centres must be more than 5 m apart."""
    before = episode.begin(trap_world(ego_x))
    after = EVALUATE(before, before.world, jnp.float32(0.0), 50)
    assert bool(after.stats.escaped) == escaped


def test_an_escape_in_the_decision_of_an_accident_does_not_count():
    before = episode.begin(trap_world(120.0))
    after = EVALUATE(before, change(before.world, crashed=[True]), jnp.float32(0.0), 50)
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


@pytest.mark.parametrize("frequencies", [(10, 2), (15, 2), (30, 16)])
def test_one_reward_counts_in_each_simulated_second(frequencies):
    driving = DrivingSettings(*frequencies)
    state = episode.begin(trap_world(0.0))
    evaluate = jax.jit(partial(episode.evaluate_step, driving))
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
        world = change(world, crashed=[True]) if decision == 4 else world
        state = EVALUATE(state, world, jnp.float32(0.0), 50)
        rewards.append(float(state.outcome.reward))
        speeds.append(float(world.vehicles.speed[0]))
        assert bool(state.stats.success) == (decision < 4)
        assert int(state.stats.escape_decision) == 1
    assert rewards[-1] == -10.0
    assert float(state.stats.reward) == pytest.approx(sum(rewards))
    assert float(state.stats.timestep_reward) == pytest.approx(rewards[1] + rewards[3])
    assert float(state.stats.speed_sum) == pytest.approx(sum(speeds))


@pytest.mark.slow
def test_episodes_are_the_same_in_batches_of_any_size():
    """To the bit; of 768 worlds of 12 vehicles a CPU takes a block at a time."""
    indices = np.arange(768)
    chosen = np.random.default_rng(2).integers(0, 9, (50, 768)).astype(np.int32)

    @jax.jit
    def drive(indices, chosen):
        def start(index):
            return trap.sample(TrapSettings(), trap.start_key(5, "training", index), "training")

        def decide(states, actions):
            after = jax.vmap(lambda state, action: STEP(state, action, 50))(states, actions)
            return after, after.world.vehicles

        begun = jax.vmap(lambda index: episode.begin(start(index)))(indices)
        return jax.lax.scan(decide, begun, chosen)

    last, along = drive(indices, chosen)
    for size in (1, 96):
        some = slice(size, 2 * size)
        expected = taken(last, some), jax.tree.map(lambda leaf: leaf[:, some], along)  # noqa: B023
        found = drive(indices[some], chosen[:, some])
        jax.tree.map(np.testing.assert_array_equal, found, expected)
