"""`lanewise bench`: workloads begin together, figures are kept, the table is whole."""

import json
import sys
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import pytest

from lanewise.bench import processes, suite, workloads
from lanewise.bench.suite import Measurement
from lanewise.cli.main import main
from lanewise.driving import actions, observation
from lanewise.errors import LanewiseError
from lanewise.learning.settings import LearnerSettings
from lanewise.system import process

WORKLOAD = """
import os, time

def measured(seed, fails=False):
    print("noise")
    time.sleep(0.3 * seed)
    ready = time.time()
    def timed():
        print("more noise")
        if fails:
            raise ValueError("lost the road")
        cores = len(os.sched_getaffinity(0))
        return {"value": 1.0, "unit": "s", "detail": {
            "times": {str(seed): [ready, time.time()]}, "cores": cores, "part": seed}}
    return timed
"""


@pytest.fixture
def workload(tmp_path):
    path = tmp_path / "workload.py"
    path.write_text(WORKLOAD)
    return path


def measure(workload, groups, **arguments):
    return processes.measure(workload, "measured", arguments, groups, Path(sys.executable))


def test_workers_have_their_own_cores_and_begin_when_all_are_ready(workload, monkeypatch):
    results = []
    monkeypatch.setattr(processes, "combined", results.extend)
    usable = process.usable_cores()
    measure(workload, [usable[:1], usable[:1], usable])
    times = [result["detail"]["times"][str(seed)] for seed, result in enumerate(results)]
    assert max(ready for ready, _ in times) <= min(begun for _, begun in times)
    assert [result["detail"]["cores"] for result in results] == [1, 1, len(usable)]
    # Its own, not that of this process, which has JAX.
    for result in results:
        assert 2**20 < result["detail"]["peak_memory_bytes"] < 60 * 2**20


def test_a_worker_that_fails(workload):
    with pytest.raises(LanewiseError, match="measuring measured failed: ValueError: lost the road"):
        measure(workload, [process.usable_cores()[:1]], fails=True)


@pytest.mark.parametrize("count", [1, 2])
def test_every_part_has_workloads_that_exist(count):
    found = suite.benchmarks(1.0, count, gpu=True)
    assert {each.part for each in found} == set(suite.PARTS)
    assert len({each.label for each in found}) == len(found)
    for each in found:
        assert f"def {each.function}(" in each.file.read_text()
        assert each.cores <= count


def test_the_operations_of_an_update_are_those_of_its_networks():
    # By hand: three forward passes, and for 26-512-512-9 all products of the backward pass but
    # the one for the input's gradient.
    layers = [26 * 512, 512 * 512, 512 * 9]
    by_hand = 2 * 64 * (3 * sum(layers) + sum(layers) + layers[1] + layers[2])
    assert workloads.update_flops(26, (512, 512), 9, 64) == by_hand
    settings = LearnerSettings()
    assert (observation.SIZE, settings.hidden, actions.COUNT) == (26, (512, 512), 9)
    assert settings.batch_size == suite.BATCH


@pytest.fixture
def fake(monkeypatch):
    """Replaces the table of benchmarks by some that only say what they would have measured."""

    def measure(outcome):
        if isinstance(outcome, BaseException):
            raise outcome
        return Measurement("world", "a case", "lanewise", outcome, "things/s")

    def replace(*outcomes):
        found = [
            SimpleNamespace(label=str(number), part="world", measure=partial(measure, outcome))
            for number, outcome in enumerate(outcomes)
        ]
        monkeypatch.setattr(suite, "benchmarks", lambda *_: found)

    return replace


def test_the_command(fake, tmp_path, capsys):
    fake(2.5, LanewiseError("measuring it failed: out of road"))
    path = tmp_path / "new" / "bench.json"
    assert main(["bench", "world", "--out", str(path), "--json"]) == 1
    output = capsys.readouterr()
    stored = json.loads(path.read_text())
    assert json.loads(output.out) == stored
    assert [one["value"] for one in stored["figures"]] == [2.5]
    assert stored["failed"] == {"1": "measuring it failed: out of road"}
    assert stored["interrupted"] is False
    assert {"command", "date", "commit", "clean_tree", "machine", "versions"} <= set(stored)
    assert "1: measuring it failed: out of road" in output.err
    # Nothing is overwritten.
    assert main(["bench", "world", "--out", str(path)]) == 2
    assert "exists; choose another file" in capsys.readouterr().err
    assert main(["bench", "world"]) == 1
    assert "a case" in capsys.readouterr().out


def test_what_was_measured_before_ctrl_c_is_kept(fake, tmp_path, capsys):
    fake(1.0, KeyboardInterrupt(), AssertionError("went on"))
    path = tmp_path / "bench.json"
    assert main(["bench", "world", "--out", str(path)]) == 130
    stored = json.loads(path.read_text())
    assert stored["interrupted"]
    assert len(stored["figures"]) == 1
    assert "interrupted" in capsys.readouterr().err


SIZE = {"vehicles": 5, "lanes": 3, "seconds": 0.05}
SMALL = {
    "world": SIZE | {"worlds": 4},
    "decision": SIZE,
    "update": {"seconds": 0.05},
    "training": {"worlds": 2, "seconds": 0.05},
}


@pytest.mark.slow
@pytest.mark.parametrize("function", SMALL)
def test_each_workload_measures(function, unoptimised, monkeypatch):
    # One program for both trainings.
    monkeypatch.setattr(workloads, "NEVER", workloads.WARM_UP)
    found = getattr(workloads, function)(**SMALL[function])()
    assert found["value"] > 0
    if function == "world":
        ticks = found["detail"]["decisions_per_second"] * 5 * 5
        assert found["value"] == pytest.approx(ticks)
    if function == "training":
        split = found["detail"]["milliseconds_a_step"]
        assert sum(split.values()) == pytest.approx(1e3 / found["value"])


def test_many_seeds_are_all_counted(monkeypatch):
    """With a training that only counts its chunks."""
    over = SimpleNamespace(block_until_ready=lambda: None)
    metrics = SimpleNamespace(episodes=SimpleNamespace(outcome=SimpleNamespace(over=over)))
    calls = []

    def advance(state):
        calls.append(state)
        return state, metrics

    monkeypatch.setattr(workloads, "in_one_loop", lambda course, keys: (len(keys), advance))
    monkeypatch.setattr(workloads, "_calls_per_second", lambda call, seconds: 10.0)
    timed = workloads.many_seeds(count=3, worlds=2, seconds=0.0)
    assert set(calls) == {3}
    assert len(calls) * 2 * 50 > workloads.WARM_UP
    assert timed()["value"] == 10.0 * 50 * 2 * 3
