import numpy as np
import pytest
from parity_compare import compare_runs, default_env
from parity_states import paper_traffic

from lanewise.interop.highway_env import build_env, read_world


@pytest.mark.slow
def test_free_runs_of_paper_traffic():
    rng = np.random.default_rng(1)
    worlds = [paper_traffic(rng) for _ in range(10)]
    envs = [build_env(world) for world in worlds]
    actions = rng.integers(0, 9, (10, 50))
    assert [result[0] for result in compare_runs(envs, worlds, actions)] == [50] * 10


@pytest.mark.slow
def test_free_runs_of_highway_env_default_traffic():
    rng = np.random.default_rng(2)
    envs = [default_env(seed) for seed in range(2)]
    worlds = [read_world(env) for env in envs]
    actions = rng.integers(0, 9, (2, 25))
    assert [result[0] for result in compare_runs(envs, worlds, actions)] == [25] * 2
