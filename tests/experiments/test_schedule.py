"""Jobs of an experiment: their order, what is skipped, what is left behind."""

import io
import os
import shutil
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import jax
import numpy as np
import pytest
from small_runs import moved

from lanewise.errors import RunError
from lanewise.experiments import experiment, schedule
from lanewise.experiments import jobs as jobs_module
from lanewise.runs import run_state
from lanewise.system import folder_io
from lanewise.system.folder_io import OpenFolder
from lanewise.system.progress import Progress
from untrusted_files import made_up_episodes

TINY = {
    "evaluation.duration": 2,
    **{f"{stage}.worlds": 2 for stage in ("single_level", "high_level", "low_level")},
}
TEXT = """
title = "tiny"
preset = "quick"
seeds = 2
episodes = 3
highway_env_episodes = 0
[arms.hierarchical]
controller = "hierarchical"
high_level = "planned"
[arms.planned]
controller = "planned"
[arms.rule-based]
controller = "rule-based"
seeds = 1
episodes = 2
"""


@pytest.fixture
def tiny(tmp_path):
    found = experiment.parse("tiny", TEXT)
    return found, jobs_module.of_experiment(found, tmp_path, 5, "trap-10", TINY)


def test_jobs_are_arms_times_seeds(tiny, tmp_path):
    _, jobs = tiny
    assert [job.label for job in jobs] == [
        *("hierarchical, seed 5", "hierarchical, seed 6", "planned, seed 5", "planned, seed 6"),
        "rule-based, seed 5",
    ]
    assert jobs[0].high_level == jobs[2].path == tmp_path / "runs" / "planned" / "seed-5"
    assert [sum(job.episodes.values()) for job in jobs] == [3, 3, 3, 3, 2]
    assert [job.trains for job in jobs] == [True] * 4 + [False]


def test_none_begins_before_the_one_it_borrows_from(tiny, tmp_path, monkeypatch):
    _, jobs = tiny
    order = []
    monkeypatch.setattr(schedule, "_work", lambda job, *_: order.append(job.label) or {})
    with ThreadPoolExecutor(1) as pool:
        done = [job.label for job, _ in schedule._completed(pool, jobs, 1, OpenFolder(tmp_path))]
    assert done == order
    assert len(order) == 5
    for seed in (5, 6):
        assert order.index(f"planned, seed {seed}") < order.index(f"hierarchical, seed {seed}")


def test_an_interrupted_run_that_took_over_step_1_goes_on_without_it(tiny, tmp_path, monkeypatch):
    """It has the step already; asked to take it over again, the training would refuse."""
    _, jobs = tiny
    asked = []

    def interrupted(folder, plan, reporter, high_level):
        asked.append(high_level)
        shapes = plan.weights["step-1"]
        weights = jax.tree.map(lambda leaf: np.zeros(leaf.shape, leaf.dtype), shapes)
        if not run_state.has_stage(folder, "step-1"):
            run_state.save_stage(folder, "step-1", weights, {"metrics_bytes": 0})
        raise KeyboardInterrupt

    monkeypatch.setattr(jobs_module, "train", interrupted)
    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            jobs_module.run(jobs[0], Progress(stream=io.StringIO()), OpenFolder(tmp_path))
    assert asked == [jobs[0].high_level, None]


def test_processes_share_what_they_compile_and_leave_nothing_behind(monkeypatch, tmp_path):
    """The user's own flags and cache of compiled programs are respected."""
    monkeypatch.setenv("XLA_FLAGS", "--xla_flag_of_the_user=1")
    for own in (None, str(tmp_path)):
        monkeypatch.delenv(schedule.COMPILED, raising=False)
        if own:
            monkeypatch.setenv(schedule.COMPILED, own)
        with schedule._environment():
            shared = Path(os.environ[schedule.COMPILED])
            assert shared.is_dir()
            assert os.environ["XLA_FLAGS"] == f"--xla_flag_of_the_user=1 {schedule.ONE_THREAD}"
        assert shared.exists() == (str(shared) == own)
        assert os.environ.get(schedule.COMPILED) == own
        assert os.environ["XLA_FLAGS"] == "--xla_flag_of_the_user=1"


ORPHANS = """
import os, time
from lanewise.experiments import schedule

if __name__ == "__main__":
    with schedule._pool(1) as pool:
        print(pool.submit(os.getpid).result(), flush=True)
        pool.submit(time.sleep, 600).result()
"""


def test_when_the_parent_is_killed_its_processes_end(tmp_path):
    script = tmp_path / "orphans.py"
    script.write_text(ORPHANS)
    with subprocess.Popen([sys.executable, script], stdout=subprocess.PIPE, text=True) as parent:
        child = int(parent.stdout.readline())
        os.kill(child, 0)
        parent.kill()
    for _ in range(300):
        with suppress(ProcessLookupError):
            os.kill(child, 0)
            time.sleep(0.1)
            continue
        return
    pytest.fail("the child outlives its parent")


INTERRUPTED = """
import signal, sys, time
from pathlib import Path
from types import SimpleNamespace
from lanewise.experiments import jobs as jobs_module, schedule
from lanewise.system.folder_io import OpenFolder

def run(job, reporter, out):
    (job.path / "begun").touch()
    try:
        time.sleep(60 if job.label == "long" else 0)
    except KeyboardInterrupt:
        time.sleep(1)
        (job.path / "saved").touch()
        raise
    return {}

jobs_module.run = run

if __name__ == "__main__":
    # Whoever started the tests in the background may have told them to ignore Ctrl-C.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        names, left = ("long", "short"), {"high_level": None, "done": False}
        jobs = [SimpleNamespace(label=name, path=Path(name), **left) for name in names]
        schedule.run(jobs, 2, sys.stderr, OpenFolder(Path.cwd()))
    except KeyboardInterrupt:
        print("interrupted")
"""


@pytest.mark.parametrize(
    "way",
    [
        "SIGTERM to the first process",
        pytest.param("Ctrl-C, which all hear", marks=pytest.mark.slow),
    ],
)
def test_a_job_saves_though_another_process_has_nothing_to_do(tmp_path, way):
    script = tmp_path / "interrupted.py"
    script.write_text(INTERRUPTED)
    for name in ("long", "short"):
        (tmp_path / name).mkdir()
    with subprocess.Popen(
        [sys.executable, script],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        process_group=0,
    ) as parent:
        try:
            assert any(line.startswith("[1/2] short done") for line in parent.stderr)
            while not (tmp_path / "long" / "begun").exists():
                time.sleep(0.1)
            if way.startswith("SIGTERM"):
                parent.terminate()
            else:
                os.killpg(parent.pid, signal.SIGINT)
            said, errors = parent.communicate(timeout=45)
        finally:
            with suppress(ProcessLookupError):
                os.killpg(parent.pid, signal.SIGKILL)
    assert (tmp_path / "long" / "saved").exists()
    assert said == "interrupted\n"
    assert "Traceback" not in errors


def test_a_reference_driver_is_tested_once_and_never_otherwise(tiny, tmp_path, monkeypatch):
    _, jobs = tiny
    (job,) = (each for each in jobs if not each.trains)
    scenario = replace(job.settings.scenario, trap_speed=9.0)
    monkeypatch.setattr(
        jobs_module.evaluate_trained,
        "evaluate",
        lambda trained, world, count, seed, reporter: made_up_episodes(seed, count),
    )

    def run(job):
        return list(jobs_module.run(job, Progress(stream=io.StringIO()), OpenFolder(tmp_path)))

    said = ["test rule-based, seed 5 in lanewise"]
    assert [run(job), run(job)] == [said, []]
    more = replace(job, episodes={"lanewise": 3})
    assert not more.done
    assert run(more) == said
    log = io.StringIO()
    assert schedule.run([more], 1, log, OpenFolder(tmp_path)) == {}
    assert log.getvalue() == "1 of 1 done before\n"
    jobs_module.check(more)
    with pytest.raises(RunError, match=r"other settings: there scenario\.trap_speed is 10\.0"):
        jobs_module.check(replace(job, settings=replace(job.settings, scenario=scenario)))


def replaced(out):
    """Whoever comes next has begun the same job."""
    shutil.rmtree(out)
    (out / "runs" / "rule-based" / "seed-5").mkdir(parents=True)


@pytest.mark.parametrize(
    ("change", "late"), [(moved, False), (shutil.rmtree, True), (replaced, True)]
)
def test_a_job_writes_into_no_other_folder(tmp_path, monkeypatch, change, late):
    """Be it changed before the job begins or while it is tested."""
    out, left = tmp_path / "out", []
    jobs = jobs_module.of_experiment(experiment.parse("tiny", TEXT), out, 5, "trap-10", TINY)

    def break_in(*arguments):
        change(out)
        left.extend(sorted(tmp_path.rglob("*")))

    monkeypatch.setattr(jobs_module.evaluate_trained, "evaluate", break_in)
    with folder_io.lock(out, "reproducing") as held:
        status = held.status
        if not late:
            break_in()
            with pytest.raises(RunError, match="out was moved, removed or replaced"):
                OpenFolder.same(out, status)
        # A training is refused before it begins; that of a reference driver has none.
        for job in jobs[-1:] if late else (jobs[2], jobs[-1]):
            with pytest.raises(RunError, match="out was moved, removed or replaced"):
                jobs_module.run(job, Progress(stream=io.StringIO()), held)
    assert sorted(tmp_path.rglob("*")) == left
