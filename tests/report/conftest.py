"""Made-up results for every test of the reports."""

import pytest
from fabricate import make_episodes, make_recording, make_rows

from lanewise.evaluation.episodes import Episodes, Recording


@pytest.fixture
def recording() -> Recording:
    return make_recording()


@pytest.fixture
def rows() -> list[dict]:
    return make_rows()


@pytest.fixture
def episodes() -> Episodes:
    return make_episodes()
