"""The search, against every sequence there is."""

from functools import partial
from itertools import product

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from percepts import percept_of

from lanewise.controllers import references
from lanewise.controllers.references import Search
from lanewise.controllers.settings import SearchSettings
from lanewise.driving import episode
from lanewise.driving.settings import DrivingSettings
from lanewise.evaluation import evaluator
from lanewise.evaluation.evaluator import EvaluationConfig
from lanewise.scenario.settings import TrafficSettings, TrapSettings

DRIVING = DrivingSettings()
CLOSE = TrapSettings(
    lanes=2,
    test_front_distance=7.2,
    trap_speed=8.0,
    traffic=TrafficSettings(vehicles_ahead=0),
)


@jax.jit
@partial(jax.vmap, in_axes=(None, 0))
def replayed(world, sequence):
    """(rewards, whether there was an accident) of a sequence of actions."""

    def one(state, action):
        state = episode.step(DRIVING, state, action, 100)
        return state, (state.outcome.reward, state.outcome.terminated)

    rewards, ended = jax.lax.scan(one, episode.begin(world), sequence)[1]
    return rewards, jnp.any(ended)


@pytest.mark.slow
def test_three_decisions_against_all_729_sequences_and_what_happens(monkeypatch):
    """At 7.2 m behind a car at 8 m/s many sequences end in a collision."""
    monkeypatch.setattr(evaluator, "BLOCK", 2)
    settings = Search(DRIVING, SearchSettings(per_class=30), 3)
    config = EvaluationConfig(CLOSE, DRIVING, settings, 3, at_once=1)
    outcome = evaluator.evaluate(config, {}, 0, 2)
    world = evaluator.start(config, 0, 1)
    found = jax.jit(references.plan, static_argnums=0)(settings, world)
    every = np.array([found, *product(range(9), repeat=3)], np.int32)
    rewards, ended = map(np.asarray, replayed(world, every))
    assert 100 < ended[1:].sum() < 729
    assert not ended[0]
    # Of states in one cell only the better one goes on, which may cost a little.
    best = rewards.sum(axis=1)[~ended].max()
    assert rewards[0].sum() == pytest.approx(best, abs=2e-3)
    # What was planned is what happens; one reward a second is every second decision's.
    assert outcome.accumulated_reward[1] == pytest.approx(rewards[0, 1::2].sum(), rel=1e-5)


def test_the_search_asks_for_a_privileged_percept():
    with pytest.raises(ValueError, match="privileged"):
        Search(DRIVING, SearchSettings(), 2).start(percept_of())


def test_ranks_within_groups():
    rng = np.random.default_rng(0)
    group, value = rng.integers(0, 5, 60), rng.normal(size=60)
    expected = [int(np.sum((group == group[i]) & (value > value[i]))) for i in range(60)]
    found = references._rank(jnp.asarray(group), jnp.asarray(value))
    assert found.tolist() == expected
