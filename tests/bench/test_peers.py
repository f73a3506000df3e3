"""Peers: found or left out, and how ours compare with them."""

import json
import sys
from itertools import pairwise
from pathlib import Path

import own_workloads
import peers
import pytest
import ratios
from ratios import LEVEL, LEVEL_CACHED, SB3_TRAINING

from lanewise.bench import suite
from lanewise.bench.session import table
from lanewise.bench.suite import Benchmark, Measurement, training_case


def figure(part, case, subject, value, unit="things/s", **detail):
    return Measurement(part, case, subject, value, unit, detail)


def test_a_peer_is_measured_by_the_interpreter_that_has_it():
    other = Path("other")
    assert {each.python for each in peers.beside(1.0, 2, 2, {})} == {Path(sys.executable)}
    everything = peers.beside(1.0, 2, 2, dict.fromkeys(peers.NEEDS, other))
    for each in everything:
        assert (each.python == other) == each.file.name.startswith("peer_")
        assert f"def {each.function}(" in each.file.read_text()
    ordered = peers.ordered([*suite.benchmarks(1.0, 2), *everything])
    assert len({each.label for each in ordered}) == len(ordered)
    # What is compared is measured one after the other.
    cases = [(each.part, each.case) for each in ordered]
    assert sum(a != b for a, b in pairwise(cases)) + 1 == len(set(cases))


def test_one_run_measures_both_and_stores_the_ratio(monkeypatch, tmp_path, capsys):
    def measure(one):
        return figure(one.part, one.case, one.subject, 2.0 if "highway" in one.subject else 8.0)

    monkeypatch.setattr(Benchmark, "measure", measure)
    path = tmp_path / "peers.json"
    assert peers.main(["latency", "world", "--out", str(path)]) == 0
    stored = json.loads(path.read_text())
    found = {ratio["what"]: ratio["value"] for ratio in stored["ratios"]}
    assert found["world, 12 vehicles, 1 core, against highway-env"] == 4.0
    assert {"commit", "clean_tree", "machine", "versions"} <= set(stored)
    output = capsys.readouterr()
    assert "side by side" in output.out
    assert "not installed, left out: EnvPool" in output.err


def test_where_the_time_went_adds_up():
    times = [
        {"stage": "step-1", "chunk": chunk, "seconds": seconds, "validation": validation}
        for chunk, (seconds, validation) in enumerate(
            [(9.0, 0.0), (6.0, 5.0), (1.0, 0.0), (3.0, 2.0)]
        )
    ]
    times.append({**times[0], "stage": "step-2", "seconds": 2.0})
    # Chunks without validation take 1 s (median), validations 3.5; step 2 has one chunk.
    assert own_workloads.breakdown(30.0, 12.0, times) == {
        "compilation": 12.0,
        "driving and updates": 6.0,
        "validation": 7.0,
        "start, saving, the rest": 5.0,
    }
    assert own_workloads.covered([(1.0, 4.0), (2.0, 3.0), (3.5, 5.0), (7.0, 8.0)]) == 5.0


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
        figure("training", training_case(False, 2), SB3_TRAINING, 20.0),
        figure("level", LEVEL_CACHED, "lanewise, seed 0", 60.0),
        *(figure("level", LEVEL, f"lanewise, seed {i}", 90.0 + 10 * i) for i in range(3)),
        figure("start-up", "lanewise --help", "lanewise --help", 0.3),
    ]
    found = {ratio.what: ratio.value for ratio in ratios.of(figures, 2)}
    assert found == {
        f"world, {case}, against EnvPool": 5.0,
        f"world, {case}, against highway-env": 20.0,
        f"world, {case}, against one highway-env": 30.0,
        "one decision of one world, 12 vehicles, against highway-env": 100.0,
        # The fastest of the peer's own ways, and the fastest product that was measured.
        "update, x, against PyTorch, double DQN": 2.0,
        "update, x, of the matrix product's rate": 75.0,
        "a hierarchical controller at the paper's level": 100.0,
        "steps that Stable-Baselines3's DQN takes on highway-env in that time": 2000.0,
        "lanewise --help": 0.3,
    }
    assert "world: 12 vehicles, 2 cores" in table(figures)
    # Without a peer, or without ours, there is nothing to compare.
    alone = [each for each in figures if "lanewise" not in each.subject]
    assert ratios.of(alone, 2) == []


SIZE = {"vehicles": 5, "lanes": 3}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("file", "function", "arguments"),
    [
        ("peer_highway_env", "world", SIZE | {"seconds": 0.05}),
        ("peer_highway_env", "same_endings", SIZE | {"count": 2}),
        ("own_workloads", "matrix_product", {"rows": 8, "inner": 8, "columns": 8, "seconds": 0.1}),
    ],
)
def test_workloads_beside_ours_measure(file, function, arguments, unoptimised):
    one = {"part": "", "case": "", "subject": "", "function": function, "arguments": arguments}
    found = Benchmark(**one, file=peers.HERE / f"{file}.py").measure()
    assert found.value > 0
    if function == "same_endings":
        assert (found.value, found.detail["different"]) == (2.0, [])
