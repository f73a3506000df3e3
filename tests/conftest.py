"""What all tests share: programs compiled by one test are found by the others."""

import os
import tempfile

import pytest

CACHE = "JAX_COMPILATION_CACHE_DIR"


def pytest_configure(config: pytest.Config) -> None:
    """Let all processes of a run keep compiled programs in one place, which ends with the run.

    Tests in several files, and the commands they start, compile the same programs. Whoever sets the
    variable keeps programs from run to run.
    """
    if CACHE not in os.environ:
        place = tempfile.TemporaryDirectory(prefix="lanewise-tests-")
        os.environ[CACHE] = place.name
        config.add_cleanup(place.cleanup)
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.2")
