"""The soak tells results that differ from times that may, and memory that grows."""

import pytest
import soak


def test_times_may_differ_and_nothing_else():
    report = {"date": "today", "arms": [{"seconds": 3.0, "success": 1.0}]}
    later = {"date": "tomorrow", "arms": [{"seconds": 4.0, "success": 1.0}]}
    worse = {"date": "today", "arms": [{"seconds": 3.0, "success": 0.9}]}
    assert soak._timeless(report) == soak._timeless(later)
    assert soak._timeless(report) != soak._timeless(worse)


@pytest.mark.parametrize(
    ("memory", "growth"),
    [
        ([1110, 885, 941, 922, 837, 920, 857, 935, 835, 855], 0.994),
        # The first says nothing: it compiles.
        ([1110, 500, 600, 700, 800], 1.333),
        ([900, 800], 1.0),
        ([900], 1.0),
    ],
)
def test_memory_of_the_later_half(memory, growth):
    assert soak.growth(memory) == growth
    assert (growth > soak.GROWTH) == (memory[-1] == 800 and len(memory) == 5)
