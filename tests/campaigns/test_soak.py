"""The soak tells results that differ from times that may, and memory that grows."""

import numpy as np
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


class Ended:
    """A reproduction that is stopped when it has just written its report, and started again."""

    largest, starts, said = 0, 0, ""

    def __init__(self, out, words, environment):
        type(self).starts += 1

    def wait(self, seconds):
        return type(self).starts > 1

    def stop(self, way):
        pass

    def outcome(self):
        return 2, self.said


@pytest.mark.parametrize("complete", [True, False])
def test_a_stop_may_come_after_the_report(tmp_path, monkeypatch, complete):
    """Only that it is complete may be said then."""
    said = f"{tmp_path} is complete: see report.md" if complete else "out of memory"
    monkeypatch.setattr(soak, "Watched", type("Stopped", (Ended,), {"said": said}))
    rng = np.random.default_rng(0)
    if complete:
        stops, _ = soak.reproduction(tmp_path, [], {}, rng, mean=1.0)
        assert len(stops) == 1
    else:
        with pytest.raises(SystemExit, match="out of memory"):
            soak.reproduction(tmp_path, [], {}, rng, mean=1.0)
