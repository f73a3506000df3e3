"""The compiled chunk of one small stage: what it counts, draws, keeps, and finds not finite."""

from dataclasses import replace
from fractions import Fraction
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lanewise.bench import workloads
from lanewise.controllers.single_level import SingleLevel
from lanewise.driving import episode
from lanewise.driving.settings import DrivingSettings
from lanewise.evaluation import evaluator
from lanewise.evaluation.settings import EvaluationSettings
from lanewise.learning import replay
from lanewise.learning.replay import Replay, Transition
from lanewise.learning.settings import ExplorationSettings, LearnerSettings
from lanewise.scenario.settings import TrafficSettings, TrapSettings
from lanewise.training import finite_checks, stage, trainer
from lanewise.training.finite_checks import ChunkFinite, Finding
from lanewise.training.rollout import StageConfig
from lanewise.training.settings import StageSettings
from lanewise.training.trainer import StagePlan

SETTINGS = StageSettings(
    worlds=4,
    duration=20,
    updates_per_step=0.1,
    exploration=ExplorationSettings(steps=400),
    learner=LearnerSettings(hidden=(8,), batch_size=8, warm_up=50, replay_capacity=150),
)
LEVEL = "single_level"
COURSE = StageConfig(
    TrapSettings(traffic=TrafficSettings(vehicles_ahead=0)),
    DrivingSettings(),
    SingleLevel(),
    SETTINGS,
    ((LEVEL, SETTINGS),),
)


@pytest.fixture(autouse=True, scope="module")
def coasting_world():
    """Every vehicle keeps its speed: all else is as it is, and compiled in a third of the time."""

    def coast(world, duration, count):
        vehicles = world.vehicles
        moved = vehicles.x + vehicles.speed * duration * count
        return replace(world, vehicles=replace(vehicles, x=moved))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(episode, "tick", SimpleNamespace(run=coast))
        yield


def plain(tree):
    """Leaves as NumPy arrays, random keys as their numbers."""
    keys = jax.dtypes.prng_key
    leaves = jax.tree.leaves(tree)
    return [
        np.asarray(jax.random.key_data(leaf) if jnp.issubdtype(leaf.dtype, keys) else leaf)
        for leaf in leaves
    ]


def begun(seed=0):
    return stage.begin(COURSE, {}, jax.random.key(seed))


def run(seed, chunks=2):
    state, metrics = begun(seed), []
    for _ in range(chunks):
        state, one = stage.advance(COURSE, {}, state)
        metrics.append(one)
    return state, metrics


@pytest.mark.parametrize("worlds", [1, 3, 32])
@pytest.mark.parametrize("rate", [0.001, 0.125, 0.3, 2.5])
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
    levels = [one.levels[LEVEL] for one in metrics]
    assert int(levels[-1].transitions) == 400
    # 0.4 updates an iteration, from the 13th iteration on.
    assert abs(int(levels[-1].updates) - 0.4 * 88) <= 1
    assert [float(one.epsilon) for one in levels] == pytest.approx([0.26, 0.02])
    assert all(np.isfinite([float(one.loss), float(one.mean_q)]).all() for one in levels)
    done = np.asarray(metrics[0].episodes.outcome.over)
    assert done.shape == (stage.CHUNK, 4)
    assert (np.asarray(metrics[0].episodes.decisions)[done] <= 20).all()
    assert done.sum() >= 8
    assert finite_checks.findings(jax.device_get(metrics[0].finite)) == []


def test_one_seed_gives_the_same_bits_and_two_differ_in_everything():
    """In starts, weights and exploration."""
    states = [run(seed, 1) for seed in (3, 3, 4)]
    one, again, other = ([leaf.tobytes() for leaf in plain(state)] for state in states)
    assert one == again != other
    first, second = begun(3), begun(4)
    distances = [
        np.asarray(each.rollouts.episode.world.vehicles.x[:, 1]) for each in (first, second)
    ]
    assert len(np.unique(np.concatenate(distances))) == 8
    weights = [np.asarray(each.learners[LEVEL].online[-1][0]) for each in (first, second)]
    assert not np.array_equal(*weights)
    chosen = [np.asarray(states[at][0].replays[LEVEL].rows[:, 26]) for at in (1, 2)]
    assert not np.array_equal(*chosen)


def test_worlds_of_a_stage_differ_from_one_another():
    """In their first episodes, and in those begun since."""
    for state in (begun(), run(0, 1)[0]):
        positions = np.asarray(state.rollouts.episode.world.vehicles.x)
        assert len(np.unique(positions[:, 1])) == 4


def test_every_iteration_explores_anew():
    memory = run(0, 1)[0].replays[LEVEL]
    written = int(memory.position) - 150 + np.arange(150)
    chosen = np.asarray(memory.rows)[written % 150, 26]
    # Worlds write in turn; a third of the choices in the first chunk is random.
    assert all(len(set(chosen[written % 4 == world])) >= 5 for world in range(4))


def test_every_update_draws_its_own_batch(monkeypatch):
    numbers, nothing = np.arange(16, dtype=np.int32), np.zeros(16, np.float32)
    features = np.zeros((16, 2), np.float32)
    batch = Transition(features, numbers, nothing, nothing, features)
    memory = replay.add(replay.empty(16, 2), batch, jnp.ones(16, bool))

    def note(settings, seen, drawn):
        """In place of an update: which transitions were drawn, as bits."""
        return seen | (1 << drawn.action[0]), SimpleNamespace(loss=1.0, mean_q=2.0)

    monkeypatch.setattr(stage.learner, "update", note)
    settings = replace(SETTINGS, learner=replace(SETTINGS.learner, batch_size=1))
    sums = (jnp.float32(0.0),) * 3
    key = jax.random.key(0)
    seen, sums = stage._learn(settings, jnp.int32(0), memory, sums, jnp.int32(12), key)
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


def test_a_chunk_consumes_its_state_and_moves_nothing_between_host_and_device():
    before = run(0, 1)[0]
    with jax.transfer_guard("disallow"):
        state, _ = stage.advance(COURSE, {}, before)
    assert before.replays[LEVEL].rows.is_deleted()
    # The guard does see transfers: a number of the host's is refused.
    with pytest.raises(Exception, match=r"[Dd]isallowed"), jax.transfer_guard("disallow"):
        stage.advance(COURSE, {}, replace(state, iteration=np.int32(7)))


def findings_in(name, at, value):
    """In a chunk that began with one number of its state replaced, named as in a checkpoint."""
    state, _ = run(0, 1)

    def spoilt(path, leaf):
        found = jax.tree_util.keystr(path, simple=True, separator="/") == name
        return leaf.at[at].set(value) if found else leaf

    changed = jax.tree_util.tree_map_with_path(spoilt, state)
    _, metrics = stage.advance(COURSE, {}, changed)
    return finite_checks.findings(jax.device_get(metrics.finite))


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf], ids=str)
def test_what_is_seen_and_paid_is_found_with_its_world(value):
    for what, name, at in (
        ("observation", "percept/features", (2, 5)),
        ("reward", "episode/stats/reward", 2),
    ):
        first = findings_in(f"rollouts/{name}", at, value)[0]
        assert first == Finding(what, iteration=0, world=2)


@pytest.mark.parametrize(
    ("name", "at", "value"), [("online/0/0", (3, 1), np.nan), ("target/1/1", 2, -np.inf)]
)
def test_weights_and_what_they_spoil_are_found(name, at, value):
    found = {(one.what, one.level) for one in findings_in(f"learners/{LEVEL}/{name}", at, value)}
    assert ("weights", LEVEL) in found
    assert {what for what, _ in found} <= {"loss", "weights"}


def test_a_bad_transition_reaches_the_loss():
    """All rows alike, so that a batch is sure to hold one; the loss is known by its iteration."""
    found = findings_in(f"replays/{LEVEL}/rows", (slice(None), 27), np.inf)
    assert [one.what for one in found][-2:] == ["loss", "weights"]
    assert found[-2].iteration in range(1, 6)


def test_the_reward_of_an_episode_that_ended_is_found():
    """Its world holds a fresh episode by then."""
    state = begun()
    stats = replace(
        state.rollouts.episode.stats,
        decisions=jnp.full(4, 19, jnp.int32),
        reward=jnp.float32([0.0, 0.0, 0.0, jnp.inf]),
    )
    rollouts = replace(state.rollouts, episode=replace(state.rollouts.episode, stats=stats))
    _, metrics = stage.advance(COURSE, {}, replace(state, rollouts=rollouts))
    np.testing.assert_array_equal(np.argwhere(~np.asarray(metrics.finite.reward)), [[0, 3], [1, 3]])


@pytest.mark.parametrize(("position", "count"), [(3, 2), (13, 4), (10, 10), (57, 99)])
def test_of_the_replay_every_row_of_the_chunk_is_looked_at_and_no_older_one(position, count):
    """A row that no batch has drawn yet is found all the same."""
    written = {at % 10 for at in range(max(0, position - count), position)}
    spoilt = np.zeros((10, 10, 7), np.float32)
    spoilt[np.arange(10), np.arange(10), 4] = np.nan
    finite = jax.vmap(lambda rows: finite_checks._recent(Replay(rows, jnp.int32(position)), count))
    assert set(np.flatnonzero(~np.asarray(finite(spoilt)))) == written


def test_causes_come_first():
    def table(*bad):
        values = np.ones((4, 2), bool)
        for at in bad:
            values[at] = False
        return values

    found = ChunkFinite(
        observation=table((2, 1), (3, 0)),
        reward=table((1, 0), (2, 1)),
        vehicles=np.array([True, False]),
        transitions={"high": np.True_, "low": np.False_},
        loss={"high": np.array([1, 1, 1, 0], bool), "low": np.array([1, 0, 0, 0], bool)},
        weights={"high": np.False_, "low": np.True_},
    )
    assert finite_checks.findings(found) == [
        Finding("reward", iteration=1, world=0),
        Finding("observation", iteration=2, world=1),
        Finding("vehicles", world=1),
        Finding("transitions", "low"),
        Finding("loss", "low", iteration=1),
        Finding("loss", "high", iteration=3),
        Finding("weights", "high"),
    ]


@pytest.mark.slow
def test_the_replay_is_never_copied():
    """A chunk has no room for a second one."""
    large = replace(SETTINGS, learner=replace(SETTINGS.learner, replay_capacity=200_000))
    config = replace(COURSE, learning=((LEVEL, large),))
    state = jax.eval_shape(lambda: stage.begin(config, {}, jax.random.key(0)))
    program = stage.advance.__wrapped__.lower(config, {}, state).compile()
    rows = state.replays[LEVEL].rows
    assert program.memory_analysis().temp_size_in_bytes < rows.size * 4 / 10


@pytest.mark.slow
def test_each_entry_point_is_compiled_once():
    """Chunk after chunk, with validations: as many programs after the last as after the first."""
    validation = evaluator.EvaluationConfig(
        COURSE.scenario, COURSE.driving, COURSE.controller, 3, "validation"
    )
    tests = EvaluationSettings(validation_episodes=150, validation_interval=1)
    plan = StagePlan("one", COURSE, validation, tests)
    entries = (stage.begin, stage.advance, evaluator.drive_block)
    progress = trainer.begin(plan, {}, jax.random.key(3))
    progress, _ = trainer.advance(plan, {}, progress)
    after_one = [entry.__wrapped__._cache_size() for entry in entries]
    for _ in range(2):
        progress, _ = trainer.advance(plan, {}, progress)
    assert [entry.__wrapped__._cache_size() for entry in entries] == after_one
    assert progress.counters.chunks == 3


@pytest.mark.slow
def test_seeds_together_are_the_seeds_alone():
    """Many seeds in one compiled loop train as each alone."""
    keys = jax.random.split(jax.random.key(5), 3)
    states, advance = workloads.in_one_loop(COURSE, keys)
    states, metrics = advance(states)
    rewards = []
    for number, key in enumerate(keys):
        alone, one = stage.advance(COURSE, {}, stage.begin(COURSE, {}, key))
        of_it = jax.tree.map(lambda leaf, number=number: leaf[number], metrics)
        np.testing.assert_array_equal(of_it.episodes.outcome.over, one.episodes.outcome.over)
        np.testing.assert_allclose(of_it.episodes.reward, one.episodes.reward, atol=1e-4)
        updates = states.learners["single_level"].updates
        assert int(updates[number]) == int(alone.learners["single_level"].updates) > 0
        rewards.append(np.asarray(one.episodes.reward).tobytes())
    assert len(set(rewards)) == len(keys)
    assert int(states.iteration) == stage.CHUNK
