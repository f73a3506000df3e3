"""The same command gives the same bytes, whatever surrounds its process."""

import os
import subprocess
import sys

import pytest
import small_runs

from lanewise import config

pytestmark = pytest.mark.slow

SURROUNDINGS = {
    "zone, language, hash seed, 16 threads": {
        "TZ": "Pacific/Kiritimati",
        "LC_ALL": "C",
        "PYTHONHASHSEED": "12345",
        "NPROC": "16",
    },
    "one core, kept programs": {"JAX_COMPILATION_CACHE_DIR": "programs"},
    "kept programs used": {"JAX_COMPILATION_CACHE_DIR": "programs"},
    "JAX's switches": {
        "JAX_ENABLE_X64": "1",
        "JAX_THREEFRY_PARTITIONABLE": "0",
        "JAX_DEFAULT_PRNG_IMPL": "rbg",
        "JAX_RANDOM_SEED_OFFSET": "7",
        "JAX_DEFAULT_MATMUL_PRECISION": "bfloat16",
        "JAX_NUMPY_DTYPE_PROMOTION": "strict",
        "JAX_NUMPY_RANK_PROMOTION": "raise",
        "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false",
    },
}
FULL_SIZE = {"learner.hidden": (512, 512), "learner.batch_size": 64, "learner.warm_up": 100}
"""What the number of threads could change."""


def train(place, name="", seed=0):
    """The files of a training in a process of its own, and the episodes of its test."""
    environment = {k: v for k, v in os.environ.items() if k != "JAX_COMPILATION_CACHE_DIR"}
    environment |= {"JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0"}
    environment |= SURROUNDINGS.get(name, {})
    # A folder for each, as programs are kept beside.
    run, cores = place / (name.replace(",", "") or str(seed)), os.sched_getaffinity(0)
    if "one core" in name:
        os.sched_setaffinity(0, {min(cores)})
    trained = ["train", "single-level", "--settings", "s.toml", "--seed", str(seed)]
    tested = ["evaluate", str(run), "--episodes", "7", "--episodes-out", f"{run}.csv"]
    try:
        for words in ([*trained, "--out", str(run)], tested):
            subprocess.run(
                [sys.executable, "-m", "lanewise", *words], cwd=place, env=environment, check=True
            )
    finally:
        os.sched_setaffinity(0, cores)
    return small_runs.results(run) | {"test": run.with_name(f"{run.name}.csv").read_bytes()}


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    path = tmp_path_factory.mktemp("same")
    flags = small_runs.flags(2)
    flags |= {f"single_level.{name}": value for name, value in FULL_SIZE.items()}
    flags |= {"single_level.learner.replay_capacity": 1000}
    (path / "s.toml").write_text(config.dump_toml(config.compose(flags=flags)))
    return path


@pytest.fixture(scope="module")
def expected(place):
    return train(place)


@pytest.mark.skipif(not hasattr(os, "sched_getaffinity"), reason="only Linux has it")
@pytest.mark.parametrize("name", SURROUNDINGS)
def test_surroundings_change_nothing(place, expected, name):
    found = train(place, name)
    assert [file for file in expected if found[file] != expected[file]] == []


def test_another_seed_changes_everything(place, expected):
    other = train(place, seed=1)
    assert [file for file in expected if other[file] == expected[file]] == []
