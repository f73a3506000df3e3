"""Which weights a stage keeps, with scripted chunks in place of compiled ones."""

import re
from types import SimpleNamespace

import jax
import numpy as np
import pytest

from lanewise.errors import NumbersError
from lanewise.evaluation.settings import EvaluationSettings
from lanewise.runs import selected_weights
from lanewise.training import selection, trainer
from lanewise.training.finite_checks import ChunkFinite, Finding
from lanewise.training.selection import StageCounters, StageProgress
from lanewise.training.settings import StageSettings
from lanewise.training.trainer import StagePlan

CHUNK, WORLDS = trainer.stage.CHUNK, 2
NOTHING = SimpleNamespace(updates=0, transitions=0, epsilon=0.1, loss=np.nan, mean_q=np.nan)


def plan_of(keep, chunks=6, episodes=0, interval=2):
    settings = StageSettings(
        decisions=chunks * CHUNK * WORLDS, episodes=episodes, worlds=WORLDS, keep=keep
    )
    config = SimpleNamespace(budget=settings, learning=(("q", settings),))
    tests = EvaluationSettings(validation_interval=interval, fresh_episodes=20)
    return StagePlan("step-1", config, None, tests)


def state_of(chunk):
    return SimpleNamespace(learners={"q": SimpleNamespace(online=np.int32(chunk))})


def episodes_of(endings):
    """Stats of a chunk from {(iteration, world): (reward, escaped, accident)}."""
    fields = ("escaped", "success", "decisions", "reward", "timestep_reward", "speed_sum")
    stats = SimpleNamespace(**{name: np.zeros((CHUNK, WORLDS)) for name in fields})
    stats.outcome = SimpleNamespace(
        over=np.zeros((CHUNK, WORLDS), bool), accident=np.zeros((CHUNK, WORLDS), int)
    )
    for at, (reward, escaped, accident) in endings.items():
        stats.outcome.over[at], stats.outcome.accident[at] = True, accident
        stats.reward[at], stats.decisions[at] = reward, 10
        stats.escaped[at], stats.success[at] = escaped, escaped and not accident
    return stats


def validated(success, accident=0, reward=0.0):
    """Ten greedy episodes: so many successes, and so many accidents after the escape."""
    return SimpleNamespace(
        escaped=np.arange(10) < success + accident,
        success=np.arange(10) < success,
        accident=(np.arange(10) >= 10 - accident).astype(np.int8),
        accumulated_reward=np.full(10, float(reward)),
        average_speed=np.full(10, 12.5),
    )


def finite(reward=True):
    rewards = np.full((CHUNK + 1, WORLDS), True)
    rewards[2, 1] = reward
    return ChunkFinite(rewards | True, rewards, np.ones(WORLDS, bool), {}, {}, {})


@pytest.fixture
def play(monkeypatch):
    """Plays scripted chunks and validations: (the progress at the end, all reports)."""

    def run(plan, chunks, validations=()):
        script = enumerate(chunks, 1)
        tests = iter(validations)

        def advance(config, frozen, state):
            number, endings = next(script)
            plain = {
                at: (end, 0, 0) if isinstance(end, float) else end for at, end in endings.items()
            }
            return state_of(number), SimpleNamespace(
                levels={"q": NOTHING}, episodes=episodes_of(plain), finite=finite()
            )

        monkeypatch.setattr(trainer.stage, "advance", advance)
        monkeypatch.setattr(trainer.evaluator, "evaluate", lambda *_: validated(*next(tests)))
        monkeypatch.setattr(jax, "device_get", lambda tree: tree)
        weights = {"q": np.int32(0)}
        window = selection.no_window(plan.config.budget.keep, weights)
        progress, reports = StageProgress(state_of(0), weights, window), []
        while not plan.finished(progress.counters):
            progress, report = trainer.advance(plan, {}, progress)
            reports.append(report)
        return progress, reports

    return run


def kept(progress, keep="best-validation"):
    """Number of the chunk whose weights are handed on."""
    weights, chunk = selection.result(keep, progress)
    assert int(weights["q"]) == chunk
    return chunk


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
    progress, reports = play(plan_of("best-training"), chunks, [(0,)] * 6)
    assert kept(progress, "best-training") == int(np.argmax(scores)) + 1
    assert progress.counters.best_score == pytest.approx((max(scores),))
    records = [record for report in reports for record in report.episodes]
    assert [record["reward"] for record in records] == pytest.approx(rewards)
    assert [record["episode"] for record in records] == list(range(1, len(rewards) + 1))
    decisions = [record["decision"] for record in records]
    assert decisions == sorted(set(decisions))
    assert reports[-1].chunk["episodes"] == len(rewards)
    assert reports[-1].chunk["decisions"] == 6 * CHUNK * WORLDS


def test_fewer_than_ten_episodes_have_no_score(play):
    chunks = [{(0, 0): 9.0}, {(0, 0): 1.0}]
    progress, _ = play(plan_of("best-training", chunks=2), chunks, [(0,)])
    assert progress.counters.best_score == ()
    # Nothing was ever best, so the last weights are handed on.
    assert kept(progress, "best-training") == 2


def test_best_validation_keeps_the_median_of_the_best_five_in_a_row(play):
    successes = [1, 2, 3, 4, 5, 6, 7, 8, 6, 7, 2, 1]
    plan = plan_of("best-validation", chunks=12, interval=1)
    progress, reports = play(plan, [{}] * 12, [(each,) for each in successes])
    medians = [np.median(successes[end - 5 : end]) for end in range(5, 13)]
    assert progress.counters.best_score == pytest.approx((max(medians) / 10,))
    # 6, 7, 8, 6, 7 in chunks 6 to 10: the first 7 of them is in the middle.
    assert kept(progress) == 7
    # Before five validations nothing is chosen.
    assert [report.chunk["best_chunk"] for report in reports][:5] == [0, 0, 0, 0, 3]


@pytest.mark.parametrize("lucky", [0, 2, 5, 9])
def test_one_lucky_validation_is_never_kept(play, lucky):
    validations = [(0, 0, 3.0)] * 10
    validations[lucky] = (10, 0, 20.0)
    plan = plan_of("best-validation", chunks=10, interval=1)
    progress, _ = play(plan, [{}] * 10, validations)
    assert kept(progress) != lucky + 1
    assert progress.counters.best_score == pytest.approx((3.0 / selection.REWARD_SCALE,))


def test_a_stage_of_few_validations_takes_the_median_of_those(play):
    # Chunks 2, 4 and, as the stage ends there, 5 are validated: 0.9, 0.1 and 0.8 - 0.5 + 0.14.
    validations = [(9,), (1,), (8, 5, 7.0)]
    progress, reports = play(plan_of("best-validation", chunks=5), [{}] * 5, validations)
    assert kept(progress) == 5
    assert progress.counters.best_score == pytest.approx((0.3 + 7.0 / selection.REWARD_SCALE,))
    due = [r.chunk["chunk"] for r in reports if "validation_reward" in r.chunk]
    assert due == [2, 4, 5]


def test_records_tell_the_papers_success_from_ours(play):
    """Two episodes pass the trap, one of them crashes later; so do six and five in validation."""
    endings = {(0, 0): (9.0, True, 0), (1, 0): (1.0, True, 1), (2, 0): (2.0, False, 0)}
    _, (report,) = play(plan_of("last", chunks=1), [endings], [(5, 1, 1.0)])
    told = [(record["escaped"], record["success"]) for record in report.episodes]
    assert told == [(True, True), (True, False), (False, False)]
    rates = [report.chunk[f"{name}_rate"] for name in ("escape", "success", "accident")]
    assert rates == pytest.approx([2 / 3, 1 / 3, 1 / 3])
    assert report.chunk["validation_escape_rate"] == pytest.approx(0.6)
    assert report.chunk["validation_success_rate"] == pytest.approx(0.5)


def test_of_equal_scores_the_first_stays(play):
    plan = plan_of("best-validation", chunks=7, interval=1)
    progress, _ = play(plan, [{}] * 7, [(5, 0, 1.0)] * 7)
    assert kept(progress) == 3


def test_kept_and_last_weights_are_compared_on_the_same_fresh_starts(play, monkeypatch):
    validations = [(each,) for each in (1, 2, 9, 9, 9, 1, 2, 1, 2)]
    plan = plan_of("best-validation", chunks=9, interval=1)
    progress, _ = play(plan, [{}] * 9, validations)
    asked = []

    def test(config, parameters, seed, episodes):
        asked.append((int(parameters["q"]), seed, episodes))
        return validated(parameters["q"])

    monkeypatch.setattr(trainer.evaluator, "evaluate", test)
    record = selected_weights.compare(plan, {}, progress)
    assert asked == [
        (9, selected_weights.FRESH_SEED, 20),
        (record["kept_chunk"], selected_weights.FRESH_SEED, 20),
    ]
    assert record["kept_chunk"] == kept(progress) != record["last_chunk"] == 9
    assert record["kept_success_rate"] == pytest.approx(record["kept_chunk"] / 10)
    assert record["last_success_rate"] == pytest.approx(0.9)


def test_last_keeps_the_last(play):
    progress, _ = play(plan_of("last"), [{}] * 6, [(9, 0, 9.0), (0, 9, -9.0), (0, 9, -9.0)])
    assert kept(progress, "last") == 6
    assert progress.counters.best_score == ()


def test_a_stage_ends_at_its_episodes_or_its_decisions():
    by_episodes = plan_of("last", chunks=0, episodes=20)
    assert not by_episodes.finished(StageCounters(decisions=10**9, episodes=19))
    assert by_episodes.finished(StageCounters(episodes=20))
    assert by_episodes.fraction(StageCounters(episodes=5)) == pytest.approx(0.25)
    by_decisions = plan_of("last", chunks=2)
    assert not by_decisions.finished(StageCounters(decisions=CHUNK * WORLDS, episodes=999))
    assert by_decisions.finished(StageCounters(decisions=2 * CHUNK * WORLDS))


def test_a_bad_chunk_is_neither_booked_nor_validated(monkeypatch):
    """It ends in an error before its weights could count as the best."""
    metrics = SimpleNamespace(finite=finite(reward=False), episodes=None, levels={})
    monkeypatch.setattr(trainer.stage, "advance", lambda *_: (None, metrics))
    monkeypatch.setattr(trainer.evaluator, "evaluate", lambda *_: pytest.fail("validated"))
    progress = StageProgress(None, {}, {}, StageCounters(chunks=4, decisions=400))
    with pytest.raises(NumbersError, match=r"^step-1, chunk 5: a reward .* decision 404") as error:
        trainer.advance(plan_of("best-validation"), {}, progress)
    assert error.value.found == [Finding("reward", iteration=2, world=1)]


def test_what_is_said_of_a_number_that_is_not_finite():
    for found, said in (
        (Finding("reward", iteration=3, world=1), "a reward is not finite after decision 106, in"),
        (Finding("observation", iteration=0, world=0), "from the beginning on, in world 0"),
        (Finding("loss", "low_level", iteration=2), "loss of low_level .* since decision 104"),
        (Finding("weights", "high_level"), "the weights of high_level are not finite"),
        (Finding("vehicles", world=1), "state of a car is not finite, in world 1"),
    ):
        assert re.search(said, found.said(decisions=100, worlds=2))
