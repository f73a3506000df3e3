"""Which weights a stage keeps, with scripted chunks in place of compiled ones."""

from dataclasses import replace
from types import SimpleNamespace

import jax
import numpy as np
import pytest

from lanewise.driving import episode
from lanewise.driving.episode import EpisodeStats
from lanewise.scenario import trap
from lanewise.scenario.settings import TrapSettings
from lanewise.training import selection
from lanewise.training import trainer as stages
from lanewise.training.finite_checks import ChunkFinite
from lanewise.training.settings import StageSettings
from lanewise.training.trainer import StageCounters, StagePlan, StageProgress

CHUNK, WORLDS = stages.stage.CHUNK, 2
ALL_FINITE = ChunkFinite(
    np.ones((CHUNK + 1, WORLDS), bool),
    np.ones((CHUNK + 1, WORLDS), bool),
    np.ones(WORLDS, bool),
    {},
    {},
    {},
)


NOTHING = episode.begin(trap.sample(TrapSettings(), jax.random.key(0), "test")).stats


def plan_of(keep, decisions=6 * CHUNK * WORLDS, episodes=0, interval=2):
    settings = StageSettings(decisions=decisions, episodes=episodes, worlds=WORLDS, keep=keep)
    config = SimpleNamespace(budget=settings, learning=(("q", settings),))
    return StagePlan("step-1", config, None, 3, interval, fresh_episodes=20)


def state_of(chunk):
    return SimpleNamespace(learners={"q": SimpleNamespace(online=np.int32(chunk))})


def episodes_of(endings):
    """Stats of a chunk from {(iteration, world): reward}."""
    none = jax.tree.map(lambda _: np.zeros((CHUNK, WORLDS), int), NOTHING)
    stats = replace(none, reward=np.zeros((CHUNK, WORLDS)))
    for at, reward in endings.items():
        stats.outcome.truncated[at] = True
        stats.reward[at] = reward
        stats.decisions[at] = 10
    return stats


@pytest.fixture
def play(monkeypatch):
    """Plays scripted chunks and validations: (the progress at the end, all reports)."""

    def run(plan, chunks, validations=()):
        chunk_metrics = iter(chunks)
        tests = iter(validations)
        done = []

        def advance(config, frozen, state):
            done.append(1)
            chunk = next(chunk_metrics)
            nothing = SimpleNamespace(
                updates=0, transitions=0, epsilon=0.1, loss=np.nan, mean_q=np.nan
            )
            return state_of(len(done)), SimpleNamespace(
                levels={"q": nothing},
                episodes=chunk if isinstance(chunk, EpisodeStats) else episodes_of(chunk),
                finite=ALL_FINITE,
            )

        def test(*_):
            success, accident, reward = next(tests)
            return SimpleNamespace(
                escaped=np.arange(10) < success + accident,
                success=np.full(10, False) | (np.arange(10) < success),
                accident=(np.arange(10) >= 10 - accident).astype(np.int8),
                accumulated_reward=np.full(10, float(reward)),
            )

        monkeypatch.setattr(stages.stage, "advance", advance)
        monkeypatch.setattr(stages.evaluator, "evaluate", test)
        monkeypatch.setattr(jax, "device_get", lambda tree: tree)
        weights = {"q": np.int32(0)}
        window = selection.no_window(plan.config.budget.keep, weights)
        progress, reports = StageProgress(state_of(0), weights, window), []
        while not plan.finished(progress.counters):
            progress, report = stages.advance(plan, {}, progress)
            reports.append(report)
        return progress, reports

    return run


def kept(plan, progress):
    """Number of the chunk whose weights are handed on."""
    return int(stages.result(plan, progress)["q"])


def test_best_training_keeps_the_best_mean_of_the_last_ten_episodes(play):
    rng = np.random.default_rng(0)
    chunks = []
    for _ in range(6):
        places = rng.choice(CHUNK * WORLDS, size=int(rng.integers(2, 9)), replace=False)
        chunks.append({divmod(int(p), WORLDS): float(rng.normal()) for p in places})
    # The books once more: episodes in the order of (decision, world), the last ten at each chunk.
    rewards, scores = [], []
    for chunk in chunks:
        rewards += [chunk[at] for at in sorted(chunk)]
        scores.append(np.mean(rewards[-10:]) if len(rewards) >= 10 else -np.inf)
    validations = [(0, 0, 0)] * 6
    plan = plan_of("best-training")
    progress, reports = play(plan, chunks, validations)
    assert kept(plan, progress) == int(np.argmax(scores)) + 1
    assert progress.counters.best_score == pytest.approx((max(scores),))
    lines = [line for report in reports for line in report.episodes]
    assert [line["reward"] for line in lines] == pytest.approx(rewards)
    assert [line["episode"] for line in lines] == list(range(1, len(rewards) + 1))
    decisions = [line["decision"] for line in lines]
    assert decisions == sorted(set(decisions))
    assert reports[-1].chunk["episodes"] == len(rewards)
    assert reports[-1].chunk["decisions"] == 6 * CHUNK * WORLDS


def test_order_within_a_chunk_decides_which_ten_count(play):
    """Twelve episodes end at once; the first two, in order of (decision, world), drop out."""
    endings = {(i, w): 0.0 for i in range(6) for w in range(WORLDS)}
    endings[(0, 0)] = endings[(0, 1)] = 100.0
    endings[(5, 1)] = 7.0
    plan = plan_of("best-training", decisions=CHUNK * WORLDS)
    progress, _ = play(plan, [endings], [(0, 0, 0)])
    assert progress.counters.best_score == pytest.approx((0.7,))


def test_fewer_than_ten_episodes_have_no_score(play):
    plan = plan_of("best-training", decisions=2 * CHUNK * WORLDS)
    progress, _ = play(plan, [{(0, 0): 9.0}, {(0, 0): 1.0}], [(0, 0, 0)])
    assert progress.counters.best_score == ()
    # Nothing was ever best, so the last weights are handed on.
    assert kept(plan, progress) == 2


def test_a_score_weighs_success_accidents_and_reward(play):
    plan = plan_of("best-validation", decisions=2 * CHUNK * WORLDS)
    progress, reports = play(plan, [{}] * 2, [(8, 1, 7.0)])
    assert progress.counters.best_score == pytest.approx((0.7 + 7.0 / selection.REWARD_SCALE,))
    assert reports[-1].chunk["validation_success_rate"] == pytest.approx(0.8)


def test_best_validation_keeps_the_median_of_the_best_five_in_a_row(play):
    successes = [1, 2, 3, 4, 5, 6, 7, 8, 6, 7, 2, 1]
    plan = plan_of("best-validation", decisions=12 * CHUNK * WORLDS, interval=1)
    progress, reports = play(plan, [{}] * 12, [(each, 0, 0.0) for each in successes])
    medians = [np.median(successes[end - 5 : end]) for end in range(5, 13)]
    assert progress.counters.best_score == pytest.approx((max(medians) / 10,))
    # 6, 7, 8, 6, 7 in chunks 6 to 10: the first 7 of them is in the middle.
    assert kept(plan, progress) == 7
    assert successes[kept(plan, progress) - 1] == max(medians)
    # Before five validations nothing is chosen.
    assert [report.chunk["best_chunk"] for report in reports][:5] == [0, 0, 0, 0, 3]


@pytest.mark.parametrize("lucky", range(10))
def test_one_lucky_validation_is_never_kept(play, lucky):
    validations = [(0, 0, 3.0)] * 10
    validations[lucky] = (10, 0, 20.0)
    plan = plan_of("best-validation", decisions=10 * CHUNK * WORLDS, interval=1)
    progress, _ = play(plan, [{}] * 10, validations)
    assert kept(plan, progress) != lucky + 1
    assert progress.counters.best_score == pytest.approx((3.0 / selection.REWARD_SCALE,))


def test_a_stage_of_few_validations_takes_the_median_of_those(play):
    # Chunks 2, 4 and, as the stage ends there, 5 are validated.
    plan = plan_of("best-validation", decisions=5 * CHUNK * WORLDS)
    progress, reports = play(plan, [{}] * 5, [(9, 0, 0.0), (1, 0, 0.0), (4, 0, 0.0)])
    assert kept(plan, progress) == 5
    validated = [r.chunk["chunk"] for r in reports if "validation_reward" in r.chunk]
    assert validated == [2, 4, 5]


def test_lines_tell_the_papers_success_from_ours(play):
    """Two episodes pass the trap, one of them crashes later; so do six and five in validation."""

    stats = episodes_of({(0, 0): 9.0, (1, 0): 1.0, (2, 0): 2.0})
    stats.escape_decision[:2, 0] = 4
    stats.outcome.terminated[1, 0] = stats.outcome.accident[1, 0] = 1
    _, (report,) = play(plan_of("last", decisions=CHUNK * WORLDS), [stats], [(5, 1, 1.0)])
    told = [(line["escaped"], line["success"]) for line in report.episodes]
    assert told == [(True, True), (True, False), (False, False)]
    rates = [report.chunk[f"{name}_rate"] for name in ("escape", "success", "accident")]
    assert rates == pytest.approx([2 / 3, 1 / 3, 1 / 3])
    assert report.chunk["validation_escape_rate"] == pytest.approx(0.6)
    assert report.chunk["validation_success_rate"] == pytest.approx(0.5)


def test_of_equal_scores_the_first_stays(play):
    plan = plan_of("best-validation", decisions=7 * CHUNK * WORLDS, interval=1)
    progress, _ = play(plan, [{}] * 7, [(5, 0, 1.0)] * 7)
    assert kept(plan, progress) == 3


def test_kept_and_last_weights_are_compared_on_the_same_fresh_starts(play, monkeypatch):
    validations = [(each, 0, 0.0) for each in (1, 2, 9, 9, 9, 1, 2, 1, 2)]
    plan = plan_of("best-validation", decisions=9 * CHUNK * WORLDS, interval=1)
    progress, _ = play(plan, [{}] * 9, validations)
    asked = []

    def test(config, parameters, seed, episodes):
        asked.append((int(parameters["q"]), seed, episodes))
        return SimpleNamespace(
            escaped=np.ones(10, bool),
            success=np.arange(10) < parameters["q"],
            accident=np.zeros(10, np.int8),
            accumulated_reward=np.ones(10),
            average_speed=np.full(10, 12.5),
        )

    monkeypatch.setattr(stages.evaluator, "evaluate", test)
    line = stages.compare(plan, {}, progress)
    assert asked == [(9, stages.FRESH_SEED, 20), (line["kept_chunk"], stages.FRESH_SEED, 20)]
    assert line["kept_chunk"] == kept(plan, progress) != line["last_chunk"] == 9
    assert line["kept_success_rate"] == pytest.approx(line["kept_chunk"] / 10)
    assert line["last_success_rate"] == pytest.approx(0.9)


def test_last_keeps_the_last(play):
    plan = plan_of("last")
    progress, _ = play(plan, [{}] * 6, [(9, 0, 9.0), (0, 9, -9.0), (0, 9, -9.0)])
    assert kept(plan, progress) == 6
    assert progress.counters.best_score == ()


def test_a_stage_ends_at_its_episodes_or_its_decisions():
    by_episodes = plan_of("last", decisions=0, episodes=20)
    assert not by_episodes.finished(StageCounters(chunks=99, episodes=19))
    assert by_episodes.finished(StageCounters(chunks=1, episodes=20))
    assert by_episodes.last_chunk is None
    by_decisions = plan_of("last", decisions=CHUNK * WORLDS + 1)
    assert by_decisions.last_chunk == 2
    assert not by_decisions.finished(StageCounters(chunks=1, episodes=999))
    assert by_decisions.finished(StageCounters(chunks=2))
    assert by_episodes.fraction(StageCounters(episodes=5)) == pytest.approx(0.25)
