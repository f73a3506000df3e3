"""What surrounds a process is changed in it, and what two seeds share is found."""

import csv
import os
import sys
from types import SimpleNamespace

import numpy as np
import pytest
import sameness


def training(folder, loss, weights):
    folder.mkdir()
    with (folder / "chunks.csv").open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["loss", "mean_q", "reward", "speed"])
        rows.writerows([each, 1.0, 2.0, 3.0] for each in loss)
    return folder, SimpleNamespace(parameters={"low": [(np.array(weights), np.array([0.5]))]})


def test_what_two_seeds_have_in_common_is_found(tmp_path, monkeypatch):
    runs = dict([training(tmp_path / "a", [1.0, 2.0], [[0.1, 0.2]])])
    runs |= dict([training(tmp_path / "b", [1.5, 2.0], [[0.3, 0.2]])])
    monkeypatch.setattr(sameness.trained, "load", runs.get)
    assert sameness.alike(*runs) == [
        "line 1 of chunks.csv",
        "low, layer 0, weights",
        "low, layer 0, biases",
    ]


def test_files_that_differ_are_named(tmp_path, monkeypatch):
    def written(words, place, changes):
        run = place / "run"
        run.mkdir(parents=True)
        for name in sameness.FILES:
            (run / name).write_text(name + changes.get("TZ", "") * (name == "metrics.jsonl"))

    monkeypatch.setattr(sameness, "lanewise", written)
    names = ["again", "hash seed 1, another zone and language"]
    steps = []
    found = sameness.same_training("h-dqn", tmp_path, names, lambda: steps.append(1))
    assert found == {names[1]: ["metrics.jsonl"]}
    assert len(steps) == 3


@pytest.mark.skipif(not hasattr(os, "sched_getaffinity"), reason="Linux alone has it")
def test_a_process_has_what_surrounds_it_changed(tmp_path, monkeypatch):
    program = "import os; print(os.environ['NPROC'], len(os.sched_getaffinity(0)))"
    monkeypatch.setattr(sameness.sys, "executable", _stand_in(tmp_path, program))
    before = os.sched_getaffinity(0)
    assert sameness.lanewise([], tmp_path, {"NPROC": "3", "core": "one"}) == "3 1\n"
    assert os.sched_getaffinity(0) == before


def _stand_in(folder, program):
    """A Python that runs a program, whatever it is asked for."""
    path = folder / "python"
    path.write_text(f'#!/bin/sh\nexec {sys.executable} -c "{program}"\n')
    path.chmod(0o755)
    return str(path)
