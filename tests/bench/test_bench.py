"""The benchmark: peers found or left out, workers side by side, figures compared."""

import json
import sys
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from types import SimpleNamespace

import jax
import pytest

from lanewise.bench import catalogue, peers, processes, ratios, table
from lanewise.bench.parts import gpu, level, training, update
from lanewise.bench.task import Asked, Figure, Task
from lanewise.cli import bench_command
from lanewise.cli.main import main
from lanewise.driving import actions, observation
from lanewise.errors import LanewiseError
from lanewise.learning.settings import LearnerSettings
from lanewise.system import process

WITHOUT = peers.Interpreters(())


def figure(part, case, subject, value, unit="things/s", **detail):
    return Figure(part, case, subject, value, unit, detail)


def test_the_names_of_the_parts_are_known_to_the_command_line():
    assert tuple(catalogue.PARTS) == bench_command.PARTS


def test_without_peers_only_ours_is_measured():
    without = peers.Interpreters(())
    asked = Asked(1.0, 2, 2, without)
    labels = [task.label for tasks in catalogue.PARTS.values() for task in tasks(asked)]
    assert len(labels) == len(set(labels))
    for peer in ("EnvPool", "highway-env", "PyTorch", "Stable"):
        assert not any(peer in label for label in labels)
    assert without.missed == set(peers.NEEDS)


def test_only_peers_that_are_needed_are_missed():
    without = peers.Interpreters(())
    catalogue.PARTS["latency"](Asked(1.0, 2, 2, without))
    assert without.missed == {"highway-env"}


def test_where_the_time_went_adds_up():
    times = [
        {"stage": "step-1", "chunk": chunk, "seconds": seconds, "validation": validation}
        for chunk, (seconds, validation) in enumerate(
            [(9.0, 0.0), (6.0, 5.0), (1.0, 0.0), (3.0, 2.0)]
        )
    ]
    found = level.breakdown(30.0, 12.0, [*times, {**times[0], "stage": "step-2", "seconds": 2.0}])
    # Chunks without validation take 1 s and validations 2; step 2 has one chunk to go by.
    assert found == {
        "compilation": 12.0,
        "driving and updates": 6.0,
        "validation": 4.0,
        "start, saving, the rest": 8.0,
    }


def test_a_peer_is_looked_for_in_every_interpreter():
    here = peers.ask([])
    assert here.find("highway-env") == Path(sys.executable)
    # This one may have anything installed beside.
    bare = {"highway-env": "1.12.1", "lanewise": "0.1.0"}
    known = [replace(one, versions=bare) for one in here.known]
    other = peers.Interpreter(Path("other"), {"torch": "2.0", "highway-env": "1.0"})
    both = peers.Interpreters((*known, other))
    assert both.find("PyTorch") == Path("other")
    assert both.find("highway-env") == Path(sys.executable)
    assert both.find("Stable-Baselines3") is None
    assert both.versions()["highway-env"] == "1.12.1"
    assert here.versions()["highway-env"] == version("highway-env")


def test_a_gpu_is_measured_where_there_is_one(monkeypatch):
    assert gpu.is_present() == (jax.default_backend() == "gpu")
    for present in (False, True):
        monkeypatch.setattr(gpu, "is_present", lambda present=present: present)
        assert bool(gpu.tasks(Asked(1.0, 1, 1, WITHOUT))) == present


def test_no_interpreter(tmp_path):
    with pytest.raises(LanewiseError, match="is no Python interpreter"):
        peers.ask([tmp_path / "python"])


WORKER = """
import os
def prepare(seed, fails=""):
    print("noise")
    if fails == "before":
        raise ValueError("no such road")
    def measure():
        print("more noise")
        if fails == "meanwhile":
            raise ValueError("lost the road")
        cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1
        return {"seed": seed, "cores": cores}
    return measure
"""


@pytest.fixture
def workers(tmp_path, monkeypatch):
    (tmp_path / "worker.py").write_text(WORKER)
    monkeypatch.setattr(processes, "WORKERS", tmp_path)


def test_workers_side_by_side(workers):
    count = len(process.usable_cores())
    found = processes.one_each("worker", {}, count)
    assert [result["seed"] for result in found] == list(range(count))
    assert all(result["cores"] == 1 and result["peak_memory_bytes"] > 2**20 for result in found)
    assert processes.alone("worker", {"seed": 7}, count)["seed"] == 7


@pytest.mark.parametrize(
    ("when", "why"), [("before", "no such road"), ("meanwhile", "lost the road")]
)
def test_a_worker_that_fails(workers, when, why):
    with pytest.raises(LanewiseError, match=f"measuring worker failed: ValueError: {why}"):
        processes.one_each("worker", {"fails": when}, 1)


def test_our_workers_measure():
    found = processes.alone(
        "lanewise_product", {"rows": 8, "inner": 16, "columns": 16, "seconds": 0.01}, 1
    )
    assert found["flops"] == 2.0 * 8 * 16 * 16 * found["products"] > 0


def test_what_was_measured_before_ctrl_c_is_kept(monkeypatch, tmp_path, capsys):
    def stopped():
        raise KeyboardInterrupt

    def tasks(asked):
        first = Task("first", lambda: [figure("world", "a case", "lanewise", 1.0)])
        return [first, Task("second", stopped), Task("third", lambda: pytest.fail("went on"))]

    monkeypatch.setattr(catalogue, "PARTS", {"world": tasks})
    path = tmp_path / "bench.json"
    assert main(["bench", "world", "--out", str(path)]) == 130
    stored = json.loads(path.read_text())
    assert stored["interrupted"]
    assert len(stored["figures"]) == 1
    assert "interrupted" in capsys.readouterr().err


WORK = {"vehicles": 5, "lanes": 3, "seconds": 0.05, "seed": 0}
WORKERS = {
    "lanewise_world": WORK | {"worlds": 4},
    "lanewise_step": WORK,
    "highway_env_world": WORK,
    "same_endings": {"vehicles": 5, "lanes": 3, "count": 2, "seed": 0},
    "lanewise_update": {"inputs": 26, "outputs": 9, "seconds": 0.05},
    "lanewise_training": {"worlds": 2, "seconds": 0.05, "seed": 0},
    "lanewise_seeds": {"seeds": 2, "worlds": 2, "seconds": 0.05},
}


@pytest.mark.slow
@pytest.mark.parametrize("worker", WORKERS)
def test_each_worker_measures(worker):
    found = processes.alone(worker, WORKERS[worker], 1)
    assert found["seconds"] > 0
    if worker == "same_endings":
        assert (found["same"], found["different"]) == (2, [])
    else:
        assert max(found.get(name, 0) for name in ("decisions", "updates", "steps")) > 0
    if worker == "lanewise_training":
        assert found["updates"] == found["steps"]
        assert sum(found["breakdown"].values()) == pytest.approx(found["seconds"])


def test_a_command_that_fails():
    with pytest.raises(LanewiseError, match="evaluate absent failed: lanewise: error: no run in"):
        processes.output(["-m", "lanewise", "evaluate", "absent"])


def test_the_operations_of_an_update_are_those_of_its_networks():
    assert update.INPUTS == observation.SIZE
    assert update.OUTPUTS == actions.COUNT
    # By hand: three forward passes, and for 26-512-512-9 all products of the backward pass but
    # the one for the input's gradient.
    layers = [26 * 512, 512 * 512, 512 * 9]
    by_hand = 2 * 64 * (3 * sum(layers) + sum(layers) + layers[1] + layers[2])
    assert update.flops(26, (512, 512), 9, 64) == by_hand
    assert LearnerSettings().hidden == (512, 512)


def test_ratios():
    case = "12 vehicles, 2 cores"
    figures = [
        figure("world", case, "lanewise, 1 worlds", 10.0),
        figure("world", case, "lanewise, 64 worlds", 60.0),
        figure("world", case, "EnvPool", 12.0),
        figure("world", case, "highway-env", 3.0),
        figure("world", "12 vehicles, 1 core", "highway-env", 2.0),
        figure("world", "51 vehicles, 2 cores", "lanewise, 64 worlds", 60.0),
        figure("latency", "12 vehicles", "lanewise", 50.0),
        figure("latency", "12 vehicles", "highway-env", 5000.0),
        figure("update", "x", "matrix product, XLA", 200.0),
        figure("update", "x", "matrix product, PyTorch", 100.0),
        figure("update", "x", "lanewise", 900.0, gflop_per_second=150.0),
        figure("update", "x", "PyTorch, double DQN", 300.0),
        figure("update", "x", "PyTorch, double DQN, torch.compile", 450.0),
        figure("training", training.case(False, 2), training.SUBJECT_SB3, 20.0),
        figure("level", level.AGAIN, "lanewise, seed 0", 60.0),
        *(figure("level", level.CASE, f"lanewise, seed {i}", 90.0 + 10 * i) for i in range(3)),
        figure("start-up", "lanewise --help", "lanewise --help", 0.3),
    ]
    found = {ratio.what: ratio.value for ratio in ratios.of(figures, 2)}
    assert found[f"world, {case}, against EnvPool"] == 5.0
    assert found[f"world, {case}, against highway-env"] == 20.0
    assert found[f"world, {case}, against one highway-env"] == 30.0
    assert found["one decision of one world, 12 vehicles, against highway-env"] == 100.0
    # The fastest of the peer's own ways, and the fastest product that was measured.
    assert found["update, x, against PyTorch, double DQN"] == 2.0
    assert found["update, x, of the matrix product's rate"] == 75.0
    assert found["a hierarchical controller at the paper's level"] == 100.0
    taken = "steps that Stable-Baselines3's DQN takes on highway-env in that time"
    assert found[taken] == 2000.0
    assert found["lanewise --help"] == 0.3
    shown = table.text(figures, ratios.of(figures, 2))
    assert "world: 12 vehicles, 2 cores" in shown
    assert all(line == line.rstrip() for line in shown.splitlines())


def test_ratios_of_what_was_measured_alone():
    """Without a peer, or without ours, there is nothing to compare."""
    figures = [
        figure("world", "12 vehicles, 2 cores", "highway-env", 3.0),
        figure("latency", "12 vehicles", "highway-env", 5000.0),
        figure("update", "x", "PyTorch, double DQN", 300.0),
        figure("update", "y", "lanewise", 900.0),
        figure("level", level.CASE, "lanewise, seed 0", 90.0),
    ]
    found = ratios.of(figures, 2)
    assert [ratio.what for ratio in found] == ["a hierarchical controller at the paper's level"]


def test_the_command(monkeypatch, tmp_path, capsys):
    def failing():
        raise LanewiseError("measuring it failed: out of road")

    def tasks(asked):
        return [
            Task("easy", lambda: [figure("world", "a case", "lanewise", asked.seconds)]),
            Task("hard", failing),
        ]

    monkeypatch.setattr(catalogue, "PARTS", {"world": tasks})
    path = tmp_path / "new" / "bench.json"
    words = ["bench", "world", "--seconds", "2.5", "--out", str(path)]
    assert main([*words, "--json"]) == 1
    output = capsys.readouterr()
    stored = json.loads(path.read_text())
    assert json.loads(output.out) == stored
    assert [one["value"] for one in stored["figures"]] == [2.5]
    assert stored["failed"] == {"hard": "measuring it failed: out of road"}
    assert {"command", "date", "machine", "versions", "ratios"} <= set(stored)
    assert "hard: measuring it failed: out of road" in output.err
    # Nothing is overwritten.
    assert main(words) == 2
    assert "exists; choose another file" in capsys.readouterr().err
    assert main(["bench", "world"]) == 1
    assert "a case" in capsys.readouterr().out


def test_a_file_that_cannot_be_written_is_refused_before_anything_is_measured(
    monkeypatch, tmp_path, capsys
):
    def measured():
        pytest.fail("measured for nothing")

    monkeypatch.setattr(catalogue, "PARTS", {"world": lambda asked: [Task("easy", measured)]})
    for place in ("/proc/nowhere/bench.json", str(tmp_path / ("x" * 256))):
        assert main(["bench", "world", "--out", place]) == 2
        said = capsys.readouterr()
        assert said.err.startswith(f"lanewise: error: cannot write {place}: ")
        assert said.out == ""


@pytest.mark.parametrize("words", [[], ["--json"]])
def test_a_file_that_cannot_be_written_in_the_end_costs_no_figures(
    monkeypatch, tmp_path, capsys, words
):
    folder = tmp_path / "new"

    def measured():
        folder.write_text("in the way")
        return [figure("world", "a case", "lanewise", 2.5)]

    monkeypatch.setattr(catalogue, "PARTS", {"world": lambda asked: [Task("easy", measured)]})
    assert main(["bench", "world", "--out", str(folder / "bench.json"), *words]) == 2
    said = capsys.readouterr()
    assert "a case" in said.out
    assert "error: cannot write" in said.err


def test_a_reader_that_has_gone_costs_no_file(monkeypatch, tmp_path):
    def gone(text):
        raise BrokenPipeError

    found = [figure("world", "a case", "lanewise", 2.5)]
    monkeypatch.setattr(catalogue, "PARTS", {"world": lambda asked: [Task("easy", lambda: found)]})
    monkeypatch.setattr(sys, "stdout", SimpleNamespace(write=gone, flush=lambda: None))
    path = tmp_path / "bench.json"
    assert main(["bench", "world", "--json", "--out", str(path)]) == 0
    assert json.loads(path.read_text())["figures"][0]["value"] == 2.5
