"""What tests that stop and continue trainings share."""

import signal

import pytest


@pytest.fixture
def save_every_chunk(monkeypatch):
    # Not above: JAX must not be imported before ../conftest.py has set its switches.
    from lanewise.runs import training_loop

    monkeypatch.setattr(training_loop, "INTERVAL", 0.0)


@pytest.fixture(scope="module")
def hears_ctrl_c():
    """Whoever started the tests in the background may have told them to ignore it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)
