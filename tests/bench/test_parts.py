"""What the parts of the benchmark make of what their workers measure, worked out by hand."""

import itertools
import time
from pathlib import Path

import pytest

from lanewise.bench import peers, processes
from lanewise.bench.parts import latency, start_up, training, update, world
from lanewise.bench.task import Asked

ALL = peers.Interpreters(
    (
        peers.Interpreter(
            Path("all"),
            dict.fromkeys(itertools.chain.from_iterable(peers.NEEDS.values()), "1"),
        ),
    )
)
NONE = peers.Interpreters(())
DRIVEN = {
    "decisions": 30,
    "seconds": 1.5,
    "ticks_per_decision": 5,
    "ended": {"collision": 1, "time out": 3},
    "vehicles": 12,
    "compile_seconds": 2.0,
    "peak_memory_bytes": 7,
    "slowest_seconds": 0.25,
}
UPDATED = {"updates": 300, "seconds": 1.5, "compile_seconds": 2.0, "peak_memory_bytes": 7}
TRAINED = {
    "steps": 60,
    "updates": 60,
    "seconds": 1.5,
    "breakdown": {"driving": 0.9, "updates": 0.6},
    "compile_seconds": 2.0,
    "peak_memory_bytes": 7,
}
MULTIPLIED = {"flops": 3e9, "seconds": 1.5, "peak_memory_bytes": 7}
ANSWERS = {
    **dict.fromkeys(("lanewise_world", "envpool_world", "lanewise_step"), DRIVEN),
    "highway_env_world": {n: v for n, v in DRIVEN.items() if n != "compile_seconds"},
    "same_endings": {"same": 199, "different": [17], "peak_memory_bytes": 7},
    **dict.fromkeys(("lanewise_update", "torch_update", "sb3_update"), UPDATED),
    **dict.fromkeys(("lanewise_product", "torch_product"), MULTIPLIED),
    "lanewise_training": TRAINED,
    "sb3_training": {n: v for n, v in TRAINED.items() if n != "compile_seconds"},
}


@pytest.fixture(autouse=True)
def workers(monkeypatch):
    """Workers that answer at once; yields who was asked: (worker, interpreter)."""
    asked = []

    def one_each(worker, arguments, count, python=None):
        asked.append((worker, python))
        return [dict(ANSWERS[worker]) for _ in range(count)]

    def alone(worker, arguments, count, python=None):
        return one_each(worker, arguments, 1, python)[0]

    monkeypatch.setattr(processes, "one_each", one_each)
    monkeypatch.setattr(processes, "alone", alone)
    return asked


def figures(part, interpreters=ALL, cores=2):
    """Every figure of a part, by (case, subject)."""
    asked = Asked(seconds=1.0, seeds=1, cores=cores, interpreters=interpreters)
    made = [figure for task in part.tasks(asked) for figure in task.run()]
    assert len({(each.case, each.subject) for each in made}) == len(made)
    return {(each.case, each.subject): each for each in made}


def test_the_world_counts_vehicles_and_ticks_of_all_processes(workers):
    found = figures(world)
    for cores in (1, 2):
        ours = found[f"12 vehicles, {cores} core{'s' * (cores > 1)}", "lanewise, 1024 worlds"]
        assert ours.value == cores * 30 / 1.5 * 5 * 12
        assert ours.detail["episodes"] == cores * 4
        assert ours.detail["ended"] == {"collision": 0.25, "time out": 0.75}
        assert ours.detail["peak_memory_bytes"] == cores * 7
        assert ours.detail["compile_seconds"] == 2.0
    # A pool is one process with a thread for each core.
    pool = found["12 vehicles, 2 cores", "EnvPool, 64 environments"]
    assert pool.value == 30 / 1.5 * 5 * 12
    assert "compile_seconds" not in found["12 vehicles, 1 core", "highway-env"].detail
    same = found["200 starts with 12 vehicles", "lanewise"]
    assert (same.value, same.detail) == (199.0, {"different": [17]})
    peers_asked = {worker for worker, python in workers if python == Path("all")}
    assert peers_asked == {"highway_env_world", "envpool_world", "same_endings"}


def test_one_decision_in_microseconds():
    found = figures(latency)
    assert found["12 vehicles, 1 core", "lanewise"].value == 50_000.0
    assert found["51 vehicles, 1 core", "highway-env"].detail["slowest_seconds"] == 0.25
    assert len(found) == 4


def test_updates_and_the_share_of_the_product(workers):
    found = figures(update)
    ours = found["batch 64, 2 cores", "lanewise"]
    assert (ours.value, ours.unit) == (200.0, "updates/s")
    work = update.flops(26, (512, 512), 9, 64)
    assert ours.detail["gflop_per_second"] == pytest.approx(200.0 * work / 1e9)
    product = found["batch 64, 2 cores", "matrix product, XLA"]
    assert (product.value, product.unit) == (2.0, "GFLOP/s")
    # Its network is another, so its operations are not counted.
    assert "gflop_per_second" not in found["batch 64, 1 core", "Stable-Baselines3, DQN"].detail
    assert {worker for worker, python in workers if python is None} == {
        "lanewise_product",
        "lanewise_update",
    }


def test_trainings_at_once_are_added_up():
    found = figures(training)
    alone, apart = "1 training, 2 cores", "2 trainings, a core each"
    assert found[alone, "lanewise, 32 worlds"].value == 40.0
    ours = found[apart, "lanewise, 32 worlds"]
    assert ours.value == 80.0
    assert ours.detail["milliseconds_a_step"] == pytest.approx({"driving": 15.0, "updates": 10.0})
    assert ours.detail["compile_seconds"] == 2.0
    assert "compile_seconds" not in found[apart, training.SUBJECT_SB3].detail
    assert not any(case == apart for case, _ in figures(training, cores=1))


def test_the_median_of_some_starts(monkeypatch):
    # Each start is timed by two looks at the clock: they take 1, 2, ... 9 s.
    ticks = itertools.chain.from_iterable((0.0, float(n)) for n in itertools.cycle(range(1, 10)))
    monkeypatch.setattr(time, "perf_counter", lambda: next(ticks))
    monkeypatch.setattr(processes, "output", lambda words: "")
    found = figures(start_up)
    assert len(found) == len(start_up.COMMANDS)
    for figure in found.values():
        assert figure.value == 5.0
        assert figure.detail == {"least": 1.0, "most": 9.0, "repeats": 9}


@pytest.mark.parametrize("part", [world, latency, update, training])
def test_without_peers_ours_are_measured_alone(part, workers):
    figures(part, NONE)
    assert workers
    assert all(worker.startswith("lanewise_") and python is None for worker, python in workers)
