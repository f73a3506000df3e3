"""What tests that stop and continue trainings share."""

import signal

import pytest
import small_runs
from small_runs import Quiet

from lanewise.runs import train


@pytest.fixture
def save_every_chunk(monkeypatch):
    monkeypatch.setattr(train, "INTERVAL", 0.0)


@pytest.fixture(scope="module")
def hears_ctrl_c():
    """Whoever started the tests in the background may have told them to ignore it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A run that was never stopped."""
    path = tmp_path_factory.mktemp("whole") / "run"
    flags = small_runs.flags(chunks=5)
    with (
        pytest.MonkeyPatch.context() as patch,
        small_runs.create(path, flags, "hierarchical", seed=4) as folder,
    ):
        patch.setattr(train, "INTERVAL", 0.0)
        train.train(folder, None, Quiet())
    return path
