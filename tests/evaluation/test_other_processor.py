"""Tests of a trained controller end alike on processors with other instructions."""

import csv
import os
import subprocess
import sys

import numpy as np
import pytest

EXACT = ("success", "accident", "duration", "escape_time", "goals", "goals_timed_out")
NEAR = ("accumulated_reward", "average_speed", "travel_distance")


def episodes(path, flags):
    """Of a pretrained controller, by a process that compiles for so old a processor."""
    environment = os.environ | {"XLA_FLAGS": flags}
    environment.pop("JAX_COMPILATION_CACHE_DIR", None)
    words = ["evaluate", "pretrained/hierarchical", "--episodes", "100", "--episodes-out", path]
    command = [sys.executable, "-m", "lanewise", *map(str, words)]
    subprocess.run(command, env=environment, capture_output=True, check=True)
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    return {name: [row[name] for row in rows] for name in rows[0]}


@pytest.mark.slow
def test_code_for_an_older_instruction_set(tmp_path):
    """XLA's code for SSE4.2 has no fused multiply-add, so it rounds otherwise."""
    ours = episodes(tmp_path / "ours.csv", "")
    old = episodes(tmp_path / "old.csv", "--xla_cpu_max_isa=SSE4_2")
    for name in EXACT:
        assert old[name] == ours[name], name
    for name in NEAR:
        one, other = (np.array(rows[name], np.float64) for rows in (ours, old))
        np.testing.assert_allclose(one, other, rtol=1e-4, err_msg=name)
    # The flag did something: this test would pass without it.
    assert any(old[name] != ours[name] for name in NEAR)
