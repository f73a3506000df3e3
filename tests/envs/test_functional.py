"""The pure functions: vmap and scan ready, and equal to the environments made of them."""

from dataclasses import replace
from functools import partial

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import lanewise  # noqa: F401  # tells Gymnasium of the environments
from lanewise.driving.episode import Outcome
from lanewise.driving.task_functions import TaskFunctions
from lanewise.envs import functional, spaces
from lanewise.errors import LanewiseError, SettingsError
from lanewise.scenario import trap

SETTINGS = {"duration": 8.0, "vehicles_ahead": 1}
TASK = functional.make(**SETTINGS)
AFTER_STEP = jax.jit(functional.after_step, static_argnums=0)


@pytest.fixture(scope="module")
def begun():
    return functional.reset(TASK, trap.start_key(3, "training", 0))


@pytest.mark.parametrize("crashed", [False, True])
def test_a_crash_after_the_escape_leaves_the_papers_success_and_takes_ours(begun, crashed):
    state, shown = begun
    assert not shown.escaped
    ended = jnp.bool_(crashed)
    outcome = Outcome(jnp.float32(0.0), jnp.int32(crashed), ended, jnp.bool_(False))
    stats = replace(state.episode.stats, escape_decision=jnp.int32(1), outcome=outcome)
    past = replace(state.episode, stats=stats)
    _, shown = AFTER_STEP(TASK, past, state.memory, outcome.reward)
    facts = spaces.unpack(spaces.pack(shown))[1]
    assert (facts["escaped"], facts["is_success"]) == (True, not crashed)


@pytest.mark.parametrize(
    ("kind", "actions"),
    [("low-level", [1.5, True, 4j, [4]]), ("continuous", [0.5, [True, True], [1j, 0.0]])],
)
def test_a_compiled_step_refuses_what_is_of_another_kind(begun, kind, actions):
    task = functional.make(kind, **SETTINGS)
    for action in actions:
        with pytest.raises(LanewiseError, match="action must be"):
            functional.step(task, begun[0], np.asarray(action))


def test_mistakes():
    with pytest.raises(SettingsError, match="did you mean low-level"):
        functional.make("low-levl")


@pytest.mark.slow
def test_a_whole_loop_in_one_compiled_call():
    worlds = 5

    def decide(carry, key):
        states, _ = carry
        choice, fresh = jax.random.split(key)
        actions = jax.random.randint(choice, (worlds,), 0, 9)
        states, steps = jax.vmap(partial(functional.step, TASK))(states, actions)
        done = steps.terminated | steps.truncated
        states, seen = functional.restarted(TASK, states, steps, jax.random.split(fresh, worlds))
        return (states, seen), (done, steps.observation, seen, states.episode.stats.decisions)

    @jax.jit
    def loop(key):
        begun = jax.vmap(partial(functional.reset, TASK))(jax.random.split(key, worlds))
        carry = (begun[0], begun[1].observation)
        return jax.lax.scan(decide, carry, jax.random.split(key, 60))[1]

    done, last, seen, decisions = jax.device_get(loop(jax.random.key(0)))
    assert done.any()
    assert not done.all()
    assert np.array_equal(last[~done], seen[~done])
    assert (seen[done][:, 1] == 0.0).all()  # a fresh ego stands at x = 0
    assert (decisions[done] == 0).all()
    assert (decisions[~done] > 0).all()


def fast(settings, world, steering, accident):
    return jnp.where(accident, -1.0, world.vehicles.speed[0] / 10.0)


def lanes_and_speed(settings, world):
    return jnp.stack([world.vehicles.y[0] / 4.0, world.vehicles.speed[0]])


@pytest.mark.slow
def test_a_reward_and_an_observation_of_the_user_s_own():
    task = TaskFunctions(observe=lanes_and_speed, reward=fast)
    env = gymnasium.make("lanewise/Trap-v0", task=task, **SETTINGS)
    assert env.observation_space.shape == (2,)
    assert env.reset(seed=0)[0].tolist() == [0.0, 10.0]
    assert env.step(4)[1] == pytest.approx(1.0)
    many = gymnasium.make_vec("lanewise/Trap-v0", 3, task=task, **SETTINGS)
    assert many.reset(seed=0)[0].shape == (3, 2)
    assert np.allclose(many.step([4, 4, 4])[1], 1.0)
