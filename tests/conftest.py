"""What all tests share: programs that one test has compiled are found by the next."""

import fcntl
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

CACHE = "JAX_COMPILATION_CACHE_DIR"
SHELF = pytest.StashKey[Path]()
"""Where the processes of a run find each other's programs."""


def pytest_configure(config: pytest.Config) -> None:
    """Let the processes of a run, and the commands they start, share programs till its end.

    Whoever sets the variable keeps programs from run to run.
    """
    if not os.environ.get(CACHE):
        os.environ[CACHE] = _temporary(config)
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.2")
    if config.option.markexpr == "not slow":
        # These tests compile for longer than they run, so their programs are not optimised.
        # Those of the slow tests are, as users' are.
        os.environ.setdefault("JAX_DISABLE_MOST_OPTIMIZATIONS", "1")
    # Else a program's name would depend on where it is kept.
    os.environ["JAX_PERSISTENT_CACHE_ENABLE_XLA_CACHES"] = "none"
    if hasattr(config, "workerinput") or not config.getoption("numprocesses", None):
        # JAX reads what another process has not written to its end: each has a folder of its own.
        shelf = config.stash[SHELF] = Path(os.environ[CACHE])
        shelf.mkdir(parents=True, exist_ok=True)
        os.environ[CACHE] = _temporary(config)


def _temporary(config: pytest.Config) -> str:
    place = tempfile.TemporaryDirectory(prefix="lanewise-tests-")
    config.add_cleanup(place.cleanup)
    return place.name


def _add(there: Path, here: Path) -> None:
    """Every program that is there and not yet here."""
    for program in there.glob("*-cache"):
        if not (here / program.name).exists():
            beside = here / f"{program.name}.{os.getpid()}"
            shutil.copyfile(program, beside)
            beside.replace(here / program.name)


@pytest.fixture(autouse=True, scope="module")
def compiled_programs(pytestconfig: pytest.Config) -> Iterator[None]:
    """Before each file fetch the programs of other processes, after it hand over one's own."""
    shelf, own = pytestconfig.stash[SHELF], Path(os.environ[CACHE])
    _add(shelf, own)
    yield
    _add(own, shelf)
    import jax

    # In memory all together would take gigabytes.
    jax.clear_caches()


@pytest.fixture
def float64() -> Iterator[None]:
    """What JAX computes is in float64, as in highway-env."""
    import jax

    with jax.enable_x64(True):
        yield


@pytest.fixture
def refused(capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """Run a command that must be refused in one line or two: what it says."""

    def run(*words: object) -> str:
        from lanewise.cli.main import main

        capsys.readouterr()
        assert main([str(word) for word in words]) == 2, words
        said = capsys.readouterr()
        assert said.out == ""
        assert len(said.err.splitlines()) <= 2
        return said.err

    return run


@pytest.fixture
def unoptimised(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Programs compile in two thirds of the time, here and in commands: where no bit matters."""
    import jax

    monkeypatch.setenv("JAX_DISABLE_MOST_OPTIMIZATIONS", "1")
    jax.config.update("jax_disable_most_optimizations", True)
    yield
    jax.config.update("jax_disable_most_optimizations", False)


@pytest.fixture(scope="session")
def _hierarchical_runs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """One training of both steps: (the finished run, a copy made within step 2, as by a kill).

    The first process of a test run that asks for it trains; the others wait and take its files.
    """
    place = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        place = place.parent
    made = place / "hierarchical"
    with (place / "hierarchical.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not made.exists():
            begun = Path(tempfile.mkdtemp(dir=place))
            _train_both_steps(begun / "run", begun / "stopped")
            begun.rename(made)
    return made / "run", made / "stopped"


def _train_both_steps(whole: Path, stopped: Path) -> None:
    import small_runs

    from lanewise.runs import training_loop

    copy = small_runs.Quiet(("step-2", 4), lambda: shutil.copytree(whole, stopped))
    flags = small_runs.flags(chunks=5)
    with (
        pytest.MonkeyPatch.context() as patch,
        small_runs.create(whole, flags, "hierarchical", seed=4) as folder,
    ):
        patch.setattr(training_loop, "INTERVAL", 0.0)
        small_runs.train(folder, copy)


@pytest.fixture(scope="session")
def whole(_hierarchical_runs: tuple[Path, Path]) -> Path:
    """A finished hierarchical run that was never stopped; not to be changed."""
    return _hierarchical_runs[0]


@pytest.fixture
def stopped(_hierarchical_runs: tuple[Path, Path], tmp_path: Path) -> Path:
    """A copy of that run as a kill in chunk 4 of step 2 leaves it, with two checkpoints."""
    return shutil.copytree(_hierarchical_runs[1], tmp_path / "stopped")
