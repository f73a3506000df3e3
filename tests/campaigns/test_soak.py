"""The soak compares results without their times, and notices memory that grows."""

import os
import sys

import numpy as np
import pytest
import soak


def test_times_may_differ_and_nothing_else():
    report = {"date": "today", "arms": [{"seconds": 3.0, "success": 1.0}]}
    later = {"date": "tomorrow", "arms": [{"seconds": 4.0, "success": 1.0}]}
    worse = {"date": "today", "arms": [{"seconds": 3.0, "success": 0.9}]}
    assert soak.timeless(report) == soak.timeless(later)
    assert soak.timeless(report) != soak.timeless(worse)


def test_memory_of_the_later_half():
    assert soak.growth([1110, 885, 941, 922, 837, 920, 857, 935, 835, 855]) == 0.994
    # The first says nothing: it compiles.
    assert soak.growth([1110, 500, 600, 700, 800]) == 1.333 > soak.GROWTH
    assert soak.growth([900, 800]) == soak.growth([900]) == 1.0


@pytest.mark.parametrize("complete", [True, False])
def test_a_stop_may_come_after_the_report(tmp_path, monkeypatch, complete):
    """The command that is started again may then say that all is complete, and nothing else."""
    said = f"{tmp_path} is complete: see report.md" if complete else "out of memory"
    attempts = iter([(True, -9, "", 100), (False, 2, said, 90)])
    monkeypatch.setattr(soak, "attempt", lambda *_: next(attempts))
    rng = np.random.default_rng(0)
    if complete:
        stops, largest = soak.reproduction(tmp_path, {}, rng, stop=True)
        assert len(stops) == 1
        assert largest == 100
    else:
        with pytest.raises(SystemExit, match="out of memory"):
            soak.reproduction(tmp_path, {}, rng, stop=True)


def test_an_attempt_ends_by_itself_or_is_stopped_with_its_children():
    forks = "import subprocess, sys; print('begun', flush=True); subprocess.run(['sleep', '60'])"
    for program, seconds, stopped, status in (
        ("import sys; print('done'); sys.exit(3)", 60.0, False, 3),
        (forks, 2.0, True, -9),
    ):
        found = soak.attempt([sys.executable, "-c", program], os.environ, seconds, "SIGKILL")
        assert found[:2] == (stopped, status)
        assert found[2] in ("done\n", "begun\n")
        assert found[3] > 1
