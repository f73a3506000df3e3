from dataclasses import replace
from fractions import Fraction
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lanewise.controllers.hierarchical import Hierarchical
from lanewise.controllers.settings import GoalSettings
from lanewise.controllers.single_level import SingleLevel
from lanewise.driving.settings import DrivingSettings
from lanewise.learning import replay
from lanewise.learning.replay import Transition
from lanewise.learning.settings import ExplorationSettings, LearnerSettings
from lanewise.scenario.settings import TrafficSettings, TrapSettings
from lanewise.training import stage
from lanewise.training.rollout import StageConfig
from lanewise.training.settings import StageSettings

SETTINGS = StageSettings(
    worlds=4,
    duration=20,
    updates_per_step=0.1,
    exploration=ExplorationSettings(steps=400),
    learner=LearnerSettings(hidden=(8,), batch_size=8, warm_up=50, replay_capacity=150),
)
COURSE = StageConfig(
    TrapSettings(traffic=TrafficSettings(vehicles_ahead=0)),
    DrivingSettings(),
    SingleLevel(),
    SETTINGS,
    (("single_level", SETTINGS),),
)


def plain(tree):
    """Leaves as NumPy arrays, random keys as their numbers."""
    leaves = []
    for leaf in jax.tree.leaves(tree):
        if jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key):
            leaf = jax.random.key_data(leaf)
        leaves.append(np.asarray(leaf))
    return leaves


def same(a, b):
    return all(
        np.array_equal(x, y, equal_nan=x.dtype.kind == "f")
        for x, y in zip(plain(a), plain(b), strict=True)
    )


def run(seed, chunks=2):
    state = stage.begin(COURSE, {}, jax.random.key(seed))
    metrics = []
    for _ in range(chunks):
        state, one = stage.advance(COURSE, {}, state)
        metrics.append(one)
    return state, metrics


@pytest.mark.parametrize("worlds", [1, 3, 32])
@pytest.mark.parametrize("rate", [0.001, 0.01, 0.125, 0.3, 1.0, 2.5])
def test_the_running_total_of_updates_follows_the_rate(rate, worlds):
    learner = replace(SETTINGS.learner, warm_up=1)
    settings = replace(SETTINGS, worlds=worlds, updates_per_step=rate, learner=learner)
    iterations = np.arange(1, 3001)
    due = np.asarray(stage.updates_due(settings, worlds, jnp.asarray(iterations)))
    skipped = 0 if worlds > 1 else 1
    exact = Fraction(rate) * worlds
    totals = [int(exact * int(i)) - int(exact * skipped) for i in iterations]
    assert np.abs(np.cumsum(due) - totals).max() <= 1
    assert due.max() - due[skipped:].min() <= 1


def test_no_update_is_due_during_the_warm_up():
    settings = replace(SETTINGS, worlds=4, updates_per_step=1.0)
    due = np.asarray(stage.updates_due(settings, 4, jnp.arange(1, 30)))
    # 12 iterations of 4 worlds are 48 transitions of the 50 wanted.
    assert due.tolist() == [0] * 12 + [4] * 17


def test_counts_after_two_chunks():
    state, metrics = run(0)
    assert int(state.iteration) == 100
    levels = [one.levels["single_level"] for one in metrics]
    assert int(levels[-1].transitions) == 400
    # 0.4 updates an iteration, from the 13th iteration on.
    assert abs(int(levels[-1].updates) - 0.4 * 88) <= 1
    assert [float(one.epsilon) for one in levels] == pytest.approx([0.26, 0.02])
    assert all(np.isfinite([float(one.loss), float(one.mean_q)]).all() for one in levels)
    done = np.asarray(metrics[0].episodes.outcome.over)
    assert done.shape == (stage.CHUNK, 4)
    assert (np.asarray(metrics[0].episodes.decisions)[done] <= 20).all()
    assert done.sum() >= 8


def test_the_same_seed_gives_the_same_bits():
    assert same(run(3), run(3))


def test_seeds_differ_in_starts_weights_and_exploration():
    begun = [stage.begin(COURSE, {}, jax.random.key(seed)) for seed in (0, 1)]
    distances = [np.asarray(state.rollouts.episode.world.vehicles.x[:, 1]) for state in begun]
    assert len(np.unique(np.concatenate(distances))) == 8
    weights = [
        np.asarray(jax.tree.leaves(state.learners["single_level"].online)[-1]) for state in begun
    ]
    assert not np.array_equal(*weights)
    chosen = [np.asarray(run(seed, 1)[0].replays["single_level"].rows[:, 26]) for seed in (0, 1)]
    assert not np.array_equal(*chosen)


def test_worlds_of_a_stage_differ_from_one_another():
    """In their first episodes, and in those begun since."""
    for state in (stage.begin(COURSE, {}, jax.random.key(0)), run(0, 1)[0]):
        positions = np.asarray(state.rollouts.episode.world.vehicles.x)
        assert len(np.unique(positions[:, 1])) == 4


def test_every_iteration_explores_anew():
    state, _ = run(0, 1)
    memory = state.replays["single_level"]
    written = int(memory.position) - 150 + np.arange(150)
    chosen = np.asarray(memory.rows[written % 150, 26])
    # Worlds write in turn; a third of the choices in the first chunk is random.
    assert all(len(set(chosen[written % 4 == world])) >= 5 for world in range(4))


def test_every_update_draws_its_own_batch(monkeypatch):
    numbers = np.arange(16, dtype=np.int32)
    batch = Transition(
        features=np.zeros((16, 2), np.float32),
        action=numbers,
        reward=np.zeros(16, np.float32),
        discount=np.zeros(16, np.float32),
        next_features=np.zeros((16, 2), np.float32),
    )
    memory = replay.add(replay.empty(16, 2), batch, jnp.ones(16, bool))

    def note(level_settings, seen, drawn):
        """In place of an update: which transitions were drawn, as bits."""
        return seen | (1 << drawn.action[0]), SimpleNamespace(loss=1.0, mean_q=2.0)

    monkeypatch.setattr(stage.learner, "update", note)
    level_settings = replace(SETTINGS, learner=replace(SETTINGS.learner, batch_size=1))
    sums = (jnp.float32(0.0),) * 3
    key = jax.random.key(0)
    seen, sums = stage._learn(level_settings, jnp.int32(0), memory, sums, jnp.int32(12), key)
    assert int(seen).bit_count() > 4
    assert [float(one) for one in sums] == [12.0, 12.0, 24.0]


def test_a_chunk_reports_means_over_its_updates():
    state = SimpleNamespace(
        iteration=jnp.int32(50),
        replays={"q": SimpleNamespace(position=jnp.int32(9))},
        learners={"q": SimpleNamespace(updates=jnp.int32(4))},
    )
    sums = tuple(jnp.float32(value) for value in (4.0, 10.0, -6.0))
    found = stage._level_metrics(COURSE, SETTINGS, state, "q", sums)
    assert (float(found.loss), float(found.mean_q)) == (2.5, -1.5)
    assert (int(found.transitions), int(found.updates)) == (9, 4)


def test_levels_draw_from_streams_of_their_own():
    key = jax.random.key(3)
    streams = [plain(stage._of_level(key, number))[0].tolist() for number in range(3)]
    assert streams[0] == plain(key)[0].tolist()
    assert len({tuple(stream) for stream in streams}) == 3


def test_epsilon_counts_all_worlds_or_each():
    counted = replace(SETTINGS.exploration, counted="per-world")
    per_world = replace(SETTINGS, exploration=counted)
    assert float(stage.epsilon(SETTINGS, 4, jnp.int32(50))) == pytest.approx(0.5 - 0.48 / 2)
    assert float(stage.epsilon(per_world, 4, jnp.int32(50))) == pytest.approx(0.5 - 0.48 / 8)


def test_a_chunk_consumes_the_state_it_is_given():
    state = stage.begin(COURSE, {}, jax.random.key(0))
    after, _ = stage.advance(COURSE, {}, state)
    assert state.replays["single_level"].rows.is_deleted()
    assert not after.replays["single_level"].rows.is_deleted()


def test_a_chunk_moves_nothing_between_host_and_device():
    state, _ = run(0, 1)
    with jax.transfer_guard("disallow"):
        state, _ = stage.advance(COURSE, {}, state)
    # The guard does see transfers: a number of the host's is refused.
    with pytest.raises(Exception, match=r"[Dd]isallowed"), jax.transfer_guard("disallow"):
        stage.advance(COURSE, {}, replace(state, iteration=np.int32(7)))


def h_dqn_course(**low_level):
    level_settings = (
        ("high_level", SETTINGS),
        ("low_level", replace(SETTINGS, updates_per_step=0.5, **low_level)),
    )
    controller = Hierarchical(DrivingSettings(), GoalSettings(), "critic", "h-dqn")
    return StageConfig(COURSE.scenario, DrivingSettings(), controller, SETTINGS, level_settings)


def two_chunks(config):
    state = stage.begin(config, {}, jax.random.key(1))
    for _ in range(2):
        state, metrics = stage.advance(config, {}, state)
    return state, metrics


@pytest.mark.slow
def test_both_levels_learn_together_each_by_its_own_rules():
    state, metrics = two_chunks(h_dqn_course(exploration=ExplorationSettings(start=1.0, steps=800)))
    high, low = metrics.levels["high_level"], metrics.levels["low_level"]
    assert abs(int(high.updates) - 0.4 * 88) <= 1
    assert int(low.updates) == 2 * 88
    assert float(high.epsilon) == pytest.approx(0.02)
    assert float(low.epsilon) == pytest.approx(0.51)
    assert int(low.transitions) == 400
    assert 400 / 6 - 4 <= int(high.transitions) < 400
    for name, width in (("high_level", 26), ("low_level", 28)):
        rows = np.asarray(state.replays[name].rows)
        filled = int(state.replays[name].filled)
        assert rows.shape == (150, 2 * width + 3)
        assert (np.abs(rows[:filled]).sum(1) > 0).all()


@pytest.mark.slow
def test_what_pays_the_low_level_does_not_reach_the_high_level_of_a_first_chunk():
    """Before the first update nothing of a level can depend on how the other is paid."""
    states = [
        stage.advance(config, {}, stage.begin(config, {}, jax.random.key(1)))[0]
        for config in (
            h_dqn_course(learner=replace(SETTINGS.learner, warm_up=10_000, replay_capacity=10_000)),
            h_dqn_course(
                external_weight=0.0,
                goal_reward=1.0,
                learner=replace(SETTINGS.learner, warm_up=10_000, replay_capacity=10_000),
            ),
        )
    ]
    high = [np.asarray(state.replays["high_level"].rows) for state in states]
    low = [np.asarray(state.replays["low_level"].rows) for state in states]
    # The high level does learn meanwhile; what it chose and was paid is the same in both.
    np.testing.assert_array_equal(*high)
    assert not np.array_equal(*low)
    rewards = low[1][:200, 29]
    assert set(np.unique(rewards)) == {0.0, 1.0}
