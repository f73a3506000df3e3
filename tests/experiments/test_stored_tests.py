"""A stored test belongs to one run: its arm, seed, settings and weights."""

import dataclasses
import json
import shutil
from functools import partial

import numpy as np
import pytest
import small_runs

from lanewise import config
from lanewise.errors import RunError
from lanewise.evaluation import metrics
from lanewise.experiments import experiment, jobs, results, stored_tests
from lanewise.experiments.stored_tests import TESTS
from lanewise.system import safe_io, version
from lanewise.system.folder_io import OpenFolder
from lanewise.system.progress import Progress
from untrusted_files import made_up_episodes, store_test

TEXT = """
seeds = 2
episodes = 40
highway_env_episodes = 40
[arms.planned]
controller = "planned"
[arms.single-level]
controller = "single-level"
[arms.again]
controller = "single-level"
[arms.rule-based]
controller = "rule-based"
"""
FOUND = experiment.parse("x", TEXT)
FLAGS = small_runs.flags(chunks=5)


def finish(job, weight):
    """A run folder of a job with made-up weights, and its tests."""
    if job.trains:
        full = partial(np.full, fill_value=weight)
        small_runs.finish(job.path, job.settings, job.controller, job.seed, full)
    else:
        job.path.mkdir(parents=True)
        (job.path / stored_tests.SETTINGS).write_text(config.dump_toml(job.settings))
    for world in job.episodes:
        store_test(job, made_up_episodes(job.seed), world)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    place = tmp_path_factory.mktemp("made")
    for number, job in enumerate(jobs.of_experiment(FOUND, place, 0, "trap-10", FLAGS)):
        finish(job, float(number))
    return place


@pytest.fixture
def finished(made, tmp_path):
    shutil.copytree(made, tmp_path, dirs_exist_ok=True)
    found = jobs.of_experiment(FOUND, tmp_path, 0, "trap-10", FLAGS)
    return {job.label: job for job in found}


@pytest.fixture
def job(finished):
    return finished["planned, seed 0"]


def test_every_run_has_its_own_tests(finished):
    for job in finished.values():
        assert job.done
        for world in job.episodes:
            test, again = job.read_test(world), made_up_episodes(job.seed)
            assert test.seconds == 1.5
            assert test.summary == metrics.summarise(again, controller=job.controller, world=world)
    shutil.rmtree(job.path / TESTS)
    assert job.read_test("lanewise") is None
    assert not job.done


@pytest.mark.parametrize(
    ("taken", "given"),
    [
        ("planned, seed 0", "single-level, seed 0"),
        # The same settings and seed: only the weights tell.
        ("single-level, seed 0", "again, seed 0"),
        ("rule-based, seed 0", "planned, seed 0"),
    ],
)
def test_those_of_another_run_are_refused_and_kept(finished, taken, given):
    job = finished[given]
    shutil.rmtree(job.path / TESTS)
    shutil.copytree(finished[taken].path / TESTS, job.path / TESTS)
    before = {path: path.read_bytes() for path in (job.path / TESTS).iterdir()}
    said = r"lanewise\.json is a test of another run; delete it, and the test is driven again"
    with pytest.raises(RunError, match=said):
        _ = job.done
    assert {path: path.read_bytes() for path in before} == before


def test_a_test_without_its_weights_is_refused(job):
    (job.path / "controller.json").unlink()
    with pytest.raises(RunError, match=r"lanewise\.json cannot be matched .*; delete it"):
        _ = job.done


def test_an_altered_test_is_refused(job):
    path = job.path / TESTS / "lanewise.csv"
    path.write_text(path.read_text().replace(",25.0,", ",24.0,", 1))
    with pytest.raises(RunError, match=r"lanewise\.csv.* was altered; delete it") as caught:
        job.read_test("lanewise")
    assert len(str(caught.value).splitlines()) == 1


def test_a_test_and_a_report_know_the_code_that_made_them(finished, job):
    stored = json.loads((job.path / TESTS / "lanewise.json").read_text())
    assert {name: stored[name] for name in version.SOURCE} == version.source()
    assert stored["digest"] == safe_io.digest(stored)
    assert "jax" in stored["versions"]
    assert stored["machine"]["cores"]
    found = results.collect(FOUND, list(finished.values()))
    assert {seed.job.label: seed.trained_by for arm in found for seed in arm.seeds} == {
        label: version.source() if job.trains else None for label, job in finished.items()
    }


def test_settings_of_a_reference_driver_stay_as_they_were_written(finished, tmp_path):
    """A later version writes the same ones in other bytes; the tests would no longer fit."""
    job = finished["rule-based, seed 0"]
    before = dataclasses.replace(job, episodes={"highway-env": 40})
    file = job.path / stored_tests.SETTINGS
    file.write_text("# from before\n" + file.read_text())
    store_test(job, made_up_episodes(0), "highway-env")
    jobs.run(before, Progress(), OpenFolder(tmp_path))
    assert file.read_text().startswith("# from before")
    assert before.done
