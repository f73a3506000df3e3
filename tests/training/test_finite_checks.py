"""Numbers that go wrong inside a chunk are found, wherever they come in."""

import re
from dataclasses import asdict, replace
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from test_stage import COURSE

from lanewise.errors import NumbersError
from lanewise.learning.replay import Replay
from lanewise.training import findings, stage, trainer
from lanewise.training import finite_checks as finite_module
from lanewise.training.findings import Finding
from lanewise.training.finite_checks import ChunkFinite
from lanewise.training.trainer import StagePlan, StageProgress

LEVEL = "single_level"
BAD = (np.nan, np.inf, -np.inf)


@pytest.fixture(scope="module")
def begun():
    """A stage after a chunk that was as it should be, on the host."""
    state, metrics = stage.advance(COURSE, {}, stage.begin(COURSE, {}, jax.random.key(0)))
    assert findings.of(jax.device_get(metrics.finite)) == []
    return jax.device_get(state)


def spoilt(state, path, at, value):
    """The state with one number replaced: ``path`` from field to field."""
    name, *rest = path
    child = state[name] if isinstance(state, dict | tuple) else getattr(state, name)
    if rest:
        child = spoilt(child, rest, at, value)
    else:
        child = np.array(child)
        child[at] = value
    if isinstance(state, dict):
        return state | {name: child}
    if isinstance(state, tuple) and not hasattr(state, "_fields"):
        return (*state[:name], child, *state[name + 1 :])
    if isinstance(state, tuple):
        return state._replace(**{state._fields[name]: child})
    return replace(state, **{name: child})


PLACES = {
    "observation": ("rollouts", "percept", "features"),
    "reward": ("rollouts", "episode", "stats", "reward"),
    "vehicles": ("rollouts", "episode", "world", "vehicles", "x"),
    "replay": ("replays", LEVEL, "rows"),
    "online": ("learners", LEVEL, "online", 0, 0),
    "target": ("learners", LEVEL, "target", 1, 1),
}


def found_in(begun, path, at, value):
    # Copies, as a chunk consumes what it is given.
    state = jax.tree.map(jnp.array, replace(spoilt(begun, path, at, value), key=None))
    _, metrics = stage.advance(COURSE, {}, replace(state, key=jax.random.key(7)))
    return findings.of(jax.device_get(metrics.finite))


@pytest.mark.parametrize("value", BAD, ids=str)
@pytest.mark.parametrize("what", ["observation", "reward"])
def test_what_is_seen_and_paid_is_found_with_its_world(begun, what, value):
    at = (2, 5) if what == "observation" else 2
    first = found_in(begun, PLACES[what], at, value)[0]
    assert first == Finding(what, iteration=0, world=2)


@pytest.mark.parametrize("value", BAD, ids=str)
@pytest.mark.parametrize("network", ["online", "target"])
def test_weights_and_what_they_spoil_are_found(begun, network, value):
    at = (3, 1) if network == "online" else 2
    found = {(one.what, one.level) for one in found_in(begun, PLACES[network], at, value)}
    assert ("weights", LEVEL) in found
    assert {what for what, _ in found} <= {"loss", "weights"}


@pytest.mark.parametrize("value", BAD, ids=str)
def test_a_bad_transition_reaches_the_loss(begun, value):
    """All rows alike, so that a batch is sure to hold one; the loss is known by its iteration."""
    found = found_in(begun, PLACES["replay"], (slice(None), 27), value)
    assert [one.what for one in found][-2:] == ["loss", "weights"]
    assert found[-2].iteration in range(1, 6)


@pytest.mark.parametrize("value", BAD, ids=str)
@pytest.mark.parametrize(("position", "count"), [(3, 2), (13, 4), (10, 10), (57, 99)])
def test_of_the_replay_every_row_of_the_chunk_is_looked_at_and_no_older_one(position, count, value):
    """A row that no batch has drawn yet is found all the same."""
    written = {at % 10 for at in range(max(0, position - count), position)}
    for row in range(10):
        rows = jnp.zeros((10, 7)).at[row, 4].set(value)
        found = not finite_module._recent(Replay(rows, jnp.int32(position)), count)
        assert found == (row in written)


def finite(**spoilt):
    """Nothing wrong in 3 iterations of 2 worlds, but for these."""
    fine = {
        "observation": np.ones((4, 2), bool),
        "reward": np.ones((4, 2), bool),
        "vehicles": np.ones(2, bool),
        "transitions": {"high": np.True_, "low": np.True_},
        "loss": {"high": np.ones(4, bool), "low": np.ones(4, bool)},
        "weights": {"high": np.True_, "low": np.True_},
    }
    return ChunkFinite(**fine | spoilt)


def table(*bad):
    values = np.ones((4, 2), bool)
    for at in bad:
        values[at] = False
    return values


def test_causes_come_first():
    found = findings.of(
        finite(
            observation=table((2, 1), (3, 0)),
            reward=table((1, 0), (2, 1)),
            vehicles=np.array([True, False]),
            transitions={"high": np.True_, "low": np.False_},
            loss={"high": np.array([1, 1, 1, 0], bool), "low": np.array([1, 0, 0, 0], bool)},
            weights={"high": np.False_, "low": np.True_},
        )
    )
    assert found == [
        Finding("reward", iteration=1, world=0),
        Finding("observation", iteration=2, world=1),
        Finding("vehicles", world=1),
        Finding("transitions", "low"),
        Finding("loss", "low", iteration=1),
        Finding("loss", "high", iteration=3),
        Finding("weights", "high"),
    ]
    assert findings.of(finite()) == []


def test_the_reward_of_an_episode_that_ended_is_found():
    """Its world holds a fresh episode by then."""
    state = stage.begin(COURSE, {}, jax.random.key(0))
    stats = replace(
        state.rollouts.episode.stats,
        decisions=jnp.full(4, 19, jnp.int32),
        reward=jnp.float32([0.0, 0.0, 0.0, jnp.inf]),
    )
    rollouts = replace(state.rollouts, episode=replace(state.rollouts.episode, stats=stats))
    _, metrics = stage.advance(COURSE, {}, replace(state, rollouts=rollouts))
    np.testing.assert_array_equal(np.argwhere(~np.asarray(metrics.finite.reward)), [[0, 3], [1, 3]])


@pytest.mark.parametrize(
    ("found", "said"),
    [
        (Finding("reward", iteration=3, world=1), "a reward is not finite after decision 106, in"),
        (Finding("observation", iteration=0, world=0), "from the beginning on, in world 0"),
        (Finding("loss", "low_level", iteration=2), "loss of low_level .* since decision 104"),
        (Finding("weights", "high_level"), "the weights of high_level are not finite"),
        (Finding("vehicles", world=1), "state of a car is not finite, in world 1"),
    ],
)
def test_what_is_said(found, said):
    assert re.search(said, found.said(decisions=100, worlds=2))


def test_a_bad_chunk_is_neither_booked_nor_validated(monkeypatch):
    """It ends in an error before its weights could count as the best."""
    budget = SimpleNamespace(worlds=2, keep="best-validation", decisions=600, episodes=0)
    plan = StagePlan("step-2", SimpleNamespace(budget=budget, learning=()), None, 3, 1, 1)
    metrics = SimpleNamespace(finite=finite(reward=table((2, 1))), episodes=None, levels={})
    monkeypatch.setattr(trainer.evaluator, "evaluate", lambda *_: pytest.fail("validated"))
    progress = StageProgress(None, {}, {}, trainer.StageCounters(chunks=4, decisions=400))
    with pytest.raises(NumbersError, match=r"^step-2, chunk 5: a reward .* decision 404") as error:
        trainer.finish_chunk(plan, {}, progress, None, metrics)
    assert error.value.found == (asdict(Finding("reward", iteration=2, world=1)),)
