"""The search, against every sequence there is."""

from dataclasses import replace
from functools import partial
from itertools import product

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from percepts import percept_of

from lanewise.controllers import references as search
from lanewise.controllers.references import Search
from lanewise.controllers.settings import SearchSettings
from lanewise.driving import episode
from lanewise.driving.settings import DrivingSettings
from lanewise.evaluation import evaluator
from lanewise.evaluation.evaluator import EvaluationConfig
from lanewise.scenario import trap
from lanewise.scenario.settings import TrafficSettings, TrapSettings

DRIVING = DrivingSettings()
EMPTY = TrapSettings(traffic=TrafficSettings(vehicles_ahead=0))


@partial(jax.jit, static_argnums=0)
def replayed(decisions, world, sequence):
    """(sum of rewards, whether there was an accident) of a sequence of actions."""

    def one(state, action):
        state = episode.step(DRIVING, state, action, 100)
        return state, (state.outcome.reward, state.outcome.terminated)

    rewards, ended = jax.lax.scan(one, episode.begin(world), sequence)[1]
    return jnp.sum(rewards), jnp.any(ended)


@pytest.mark.slow
def test_three_decisions_against_all_729_sequences():
    """At 7.2 m behind a car at 8 m/s many sequences end in a collision."""
    scenario = replace(EMPTY, test_front_distance=7.2, trap_speed=8.0, lanes=2)
    world = trap.sample(scenario, jax.random.key(0), "test")
    every = jnp.asarray(list(product(range(9), repeat=3)), jnp.int32)
    totals, ended = jax.vmap(partial(replayed, 3, world))(every)
    assert 100 < int(ended.sum()) < 729
    best = np.asarray(jnp.where(ended, -np.inf, totals)).max()
    settings = Search(DRIVING, SearchSettings(per_class=30), 3)
    found = jax.jit(search.plan, static_argnums=0)(settings, world)
    reward, accident = replayed(3, world, found)
    assert not accident
    # Of states in one cell only the better one goes on, which may cost a little.
    assert float(reward) == pytest.approx(best, abs=2e-3)


@pytest.mark.slow
def test_what_was_planned_is_what_happens(monkeypatch):
    monkeypatch.setattr(evaluator, "BLOCK", 2)
    settings = Search(DRIVING, SearchSettings(per_class=1), 12)
    config = EvaluationConfig(EMPTY, DRIVING, settings, 12, at_once=1)
    outcome = evaluator.evaluate(config, {}, 0, 2)
    world = evaluator.start(config, 0, 1)
    states = jax.lax.scan(
        lambda state, action: (episode.step(DRIVING, state, action, 100),) * 2,
        episode.begin(world),
        jax.jit(search.plan, static_argnums=0)(settings, world),
    )[1]
    # One reward a second is every second decision's.
    assert outcome.accumulated_reward[1] == pytest.approx(
        float(np.sum(np.asarray(states.outcome.reward)[1::2])), rel=1e-5
    )


def test_the_search_asks_for_a_privileged_percept():
    with pytest.raises(ValueError, match="privileged"):
        Search(DRIVING, SearchSettings(), 2).start(percept_of())


def test_ranks_within_groups():
    rng = np.random.default_rng(0)
    group, value = rng.integers(0, 5, 60), rng.normal(size=60)
    expected = [int(np.sum((group == group[i]) & (value > value[i]))) for i in range(60)]
    found = search._rank(jnp.asarray(group), jnp.asarray(value))
    assert found.tolist() == expected
