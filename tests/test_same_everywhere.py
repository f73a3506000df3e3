"""The same command gives the same bytes, whatever surrounds its process."""

import os
import subprocess
import sys

import pytest
import small_runs

from lanewise import config

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="only Linux has it"),
]

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
