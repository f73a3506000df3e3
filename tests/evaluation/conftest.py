"""What tests of both ways of driving test episodes share."""

from collections.abc import Iterator

import pytest

from lanewise.evaluation import evaluator
from lanewise.evaluation.episodes import Episodes


@pytest.fixture(scope="module")
def small_blocks() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(evaluator, "BLOCK", 4)
        yield


@pytest.fixture(scope="module")
def ours(small_blocks: None) -> Episodes:
    from test_evaluator import COUNT, TEST, WEIGHTS

    return evaluator.evaluate(TEST, WEIGHTS, 0, COUNT)
