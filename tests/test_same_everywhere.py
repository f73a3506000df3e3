"""The same command gives the same bytes, whatever surrounds its process.

On processors with other instructions, tests of a trained controller end alike.
"""

import os
import subprocess
import sys

import numpy as np
import pytest
import small_runs

from lanewise import config
from lanewise.evaluation import metrics

pytestmark = pytest.mark.slow

KEPT = {"JAX_COMPILATION_CACHE_DIR": "programs", "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0"}
OTHERS = {
    "TZ": "Pacific/Kiritimati",
    "LC_ALL": "C",
    "PYTHONHASHSEED": "12345",
    "NPROC": "16",
    "JAX_ENABLE_X64": "1",
    "JAX_THREEFRY_PARTITIONABLE": "0",
    "JAX_DEFAULT_PRNG_IMPL": "rbg",
    "JAX_RANDOM_SEED_OFFSET": "7",
    "JAX_DEFAULT_MATMUL_PRECISION": "bfloat16",
    "JAX_NUMPY_DTYPE_PROMOTION": "strict",
    "JAX_NUMPY_RANK_PROMOTION": "raise",
    "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false",
}
"""Another zone, language, hash seed and number of threads; JAX's switches; no kept programs."""
FULL_SIZE = {"learner.hidden": (512, 512), "learner.batch_size": 64, "learner.warm_up": 100}
"""What the number of threads could change."""
COMMANDS = """
import sys
from lanewise.cli.main import main

out, seed = sys.argv[1:]
code = main(["train", "single-level", "--settings", "s.toml", "--seed", seed, "--out", out])
test = ["evaluate", out, "--episodes", "7", "--episodes-out", f"{out}.csv"]
sys.exit(code or main(test))
"""


def train(place, name, surroundings, seed=0):
    """The files of a training in a process of its own, and the episodes of its test."""
    environment = {k: v for k, v in os.environ.items() if k != "JAX_COMPILATION_CACHE_DIR"}
    command = [sys.executable, "-c", COMMANDS, name, str(seed)]
    subprocess.run(command, cwd=place, env=environment | surroundings, check=True)
    return small_runs.results(place / name) | {"test": (place / f"{name}.csv").read_bytes()}


def differing(found, expected):
    return [name for name in expected if found[name] != expected[name]]


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="only Linux has it")
def test_surroundings_change_nothing_and_another_seed_changes_everything(tmp_path):
    flags = small_runs.flags(2)
    flags |= {f"single_level.{name}": value for name, value in FULL_SIZE.items()}
    flags |= {"single_level.learner.replay_capacity": 1000}
    (tmp_path / "s.toml").write_text(config.dump_toml(config.compose(flags=flags)))
    expected = train(tmp_path, "first", KEPT)
    assert differing(train(tmp_path, "others", OTHERS), expected) == []
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(cores)})
    try:
        assert differing(train(tmp_path, "one core", KEPT), expected) == []
        other = train(tmp_path, "other seed", KEPT, seed=1)
    finally:
        os.sched_setaffinity(0, cores)
    assert differing(other, expected) == list(expected)


ALIKE = ("success", "accident", "duration", "escape_time", "goals", "goals_timed_out")
TEST = """
import sys
from lanewise.evaluation import evaluator
evaluator.BLOCK = 25
from lanewise.cli.main import main
sys.exit(main(["evaluate", "pretrained/hierarchical", "--episodes", "100", *sys.argv[1:]]))
"""


def episodes(path, flags):
    """Of a process that compiles for so old a processor."""
    environment = os.environ | {"XLA_FLAGS": flags}
    environment.pop("JAX_COMPILATION_CACHE_DIR", None)
    command = [sys.executable, "-c", TEST, "--episodes-out", path]
    subprocess.run(command, env=environment, capture_output=True, check=True)
    return metrics.from_csv(path.read_text())


def test_code_for_an_older_instruction_set(tmp_path):
    """XLA's code for SSE4.2 has no fused multiply-add, so it rounds otherwise."""
    ours = episodes(tmp_path / "ours.csv", "")
    old = episodes(tmp_path / "old.csv", "--xla_cpu_max_isa=SSE4_2")
    rounded = False
    for name, values in vars(ours).items():
        rtol = 0.0 if name in ALIKE else 1e-4
        np.testing.assert_allclose(getattr(old, name), values, rtol=rtol, err_msg=name)
        rounded |= not np.array_equal(getattr(old, name), values, equal_nan=True)
    # The flag did something: this test would pass without it.
    assert rounded
