"""What all tests share: programs that one test has compiled are found by the next."""

import os
import tempfile
from collections.abc import Iterator

import pytest

CACHE = "JAX_COMPILATION_CACHE_DIR"


def pytest_configure(config: pytest.Config) -> None:
    """Let each process of a run, and the commands it starts, keep compiled programs till its end.

    One place for all processes would not do: JAX reads what another has not written to its end.
    Whoever sets the variable keeps programs from run to run.
    """
    runs_tests = hasattr(config, "workerinput") or not config.getoption("numprocesses", None)
    if runs_tests and CACHE not in os.environ:
        place = tempfile.TemporaryDirectory(prefix="lanewise-tests-")
        os.environ[CACHE] = place.name
        config.add_cleanup(place.cleanup)
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.2")


@pytest.fixture(autouse=True, scope="module")
def forget_programs() -> Iterator[None]:
    """After each file let go of its compiled programs: all together they would take gigabytes."""
    yield
    import jax

    jax.clear_caches()
