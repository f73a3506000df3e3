"""A stored test belongs to one run: its arm, seed, settings and weights."""

import dataclasses
import json
import shutil

import jax
import numpy as np
import pytest

from lanewise import config, reading, version
from lanewise.errors import RunError
from lanewise.experiments import experiment, results, work
from lanewise.runs import trained
from lanewise.runs.files import OpenFolder
from lanewise.runs.folder import RunFolder
from lanewise.training import recipe
from untrusted_files import FLAGS, made_up_episodes

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


def finish(job, weight):
    """A run folder of a job with made-up weights, and its tests."""
    if job.trains:
        with RunFolder.create(job.path, job.settings, job.controller, job.seed) as folder:
            blank = {}
            for stage in recipe.RECIPES[job.controller]:
                blank |= trained.blank_networks(folder, stage)
            parameters = jax.tree.map(lambda leaf: np.full(leaf.shape, weight, leaf.dtype), blank)
            trained.save_controller(folder, parameters)
    else:
        job.path.mkdir(parents=True)
        (job.path / work.SETTINGS).write_text(config.dump_toml(job.settings))
    for world in job.episodes:
        run = work._origin(job)
        work._store(
            OpenFolder(job.path), job.controller, world, made_up_episodes(job.seed), 1.5, run
        )


@pytest.fixture
def jobs(tmp_path):
    found = results.jobs(experiment.parse("x", TEXT), tmp_path, 0, "trap-10", FLAGS)
    for number, job in enumerate(found):
        finish(job, float(number))
    return {job.label: job for job in found}


def sign(file, **changes):
    """Alter what a test left, None for what is to go, and sign it anew."""
    stored = json.loads(file.read_text()) | changes
    # What is null of itself stays: the commit is, where there is no checkout.
    stored = {
        name: value for name, value in stored.items() if name not in changes or value is not None
    }
    if "digest" in stored:
        stored["digest"] = reading.digest(stored)
    file.write_text(json.dumps(stored))


def test_every_run_has_its_own_tests(jobs):
    for job in jobs.values():
        assert job.done
        for world in job.episodes:
            assert work.read_test(job, world).summary.controller == job.controller


@pytest.mark.parametrize(
    ("taken", "given"),
    [
        ("planned, seed 0", "single-level, seed 0"),
        ("single-level, seed 0", "single-level, seed 1"),
        # The same settings and seed: only the weights tell.
        ("single-level, seed 0", "again, seed 0"),
        ("rule-based, seed 0", "rule-based, seed 1"),
        ("rule-based, seed 0", "planned, seed 0"),
    ],
)
def test_those_of_another_run_are_refused_and_kept(jobs, taken, given):
    job = jobs[given]
    shutil.rmtree(job.path / work.TESTS)
    shutil.copytree(jobs[taken].path / work.TESTS, job.path / work.TESTS)
    before = {path: path.read_bytes() for path in (job.path / work.TESTS).iterdir()}
    said = r"lanewise\.json is a test of another run; delete it, and the test is driven again"
    with pytest.raises(RunError, match=said):
        _ = job.done
    with pytest.raises(RunError, match=said):
        work.read_test(job, "lanewise")
    assert {path: path.read_bytes() for path in before} == before


def test_those_of_another_world_are_refused(jobs):
    job = jobs["planned, seed 0"]
    tests = job.path / work.TESTS
    for suffix in (".json", ".csv"):
        shutil.copy(tests / f"lanewise{suffix}", tests / f"highway-env{suffix}")
    with pytest.raises(RunError, match=r"highway-env\.json is a test of another run"):
        _ = job.done


@pytest.mark.parametrize("label", ["planned, seed 1", "rule-based, seed 1"])
def test_those_of_other_settings_are_refused(jobs, label, tmp_path):
    job = jobs[label]
    settings = config.replace(job.settings, {"evaluation.duration": 5})
    other = dataclasses.replace(job, path=tmp_path / "other", settings=settings)
    finish(other, 1.0)
    shutil.rmtree(other.path / work.TESTS)
    shutil.copytree(job.path / work.TESTS, other.path / work.TESTS)
    with pytest.raises(RunError, match="is a test of another run"):
        _ = other.done


def test_a_test_without_its_weights_is_refused(jobs):
    job = jobs["planned, seed 0"]
    (job.path / "controller.json").unlink()
    with pytest.raises(RunError, match=r"lanewise\.json cannot be told .*; delete it"):
        _ = job.done


def test_a_test_remembers_code_versions_and_machine(jobs):
    stored = json.loads((jobs["planned, seed 0"].path / work.TESTS / "lanewise.json").read_text())
    assert {name: stored[name] for name in version.SOURCE} == version.source()
    assert "jax" in stored["versions"]
    assert stored["machine"]["cores"]


def test_a_report_knows_by_which_code_each_seed_was_trained(jobs):
    file = jobs["planned, seed 1"].path / "run.json"
    sign(file, **dict.fromkeys(version.SOURCE))
    found = results.collect(experiment.parse("x", TEXT), list(jobs.values()))
    assert {seed.job.label: seed.trained_by for arm in found for seed in arm.seeds} == {
        label: {} if label == "planned, seed 1" else version.source() if job.trains else None
        for label, job in jobs.items()
    }


def test_a_test_from_before_tests_remembered_their_code_is_read(jobs):
    job = jobs["planned, seed 0"]
    names = (*version.SOURCE, "versions", "machine")
    sign(job.path / work.TESTS / "lanewise.json", **dict.fromkeys(names))
    assert work.read_test(job, "lanewise").summary.episodes == 40


def test_a_test_of_code_that_cannot_be_is_refused(jobs):
    job = jobs["planned, seed 0"]
    sign(job.path / work.TESTS / "lanewise.json", training="x")
    with pytest.raises(RunError, match=r"lanewise\.json is damaged; delete it"):
        work.read_test(job, "lanewise")


def test_one_from_before_both_successes_is_read_and_tells_both(jobs):
    """Its episodes have always told when the ego was past the trap."""
    job = jobs["planned, seed 0"]
    file = job.path / work.TESTS / "lanewise.json"
    whole = work.read_test(job, "lanewise").summary
    summary = json.loads(file.read_text())["summary"]
    del summary["escape_rate"], summary["intervals"]["escape_rate"]
    sign(file, summary=summary)
    assert job.done
    assert work.read_test(job, "lanewise").summary == whole
    sign(file, summary=summary | {"escape_rate": 0.125})
    with pytest.raises(RunError, match="do not agree"):
        work.read_test(job, "lanewise")


def test_tests_from_before_are_read_but_for_those_of_another_controller(jobs):
    for job in jobs.values():
        for file in (job.path / work.TESTS).glob("*.json"):
            sign(file, run=None)
    assert all(job.done for job in jobs.values())
    flat, ours = jobs["single-level, seed 0"], jobs["planned, seed 0"]
    for name in ("lanewise.json", "lanewise.csv"):
        shutil.copy(ours.path / work.TESTS / name, flat.path / work.TESTS / name)
    with pytest.raises(RunError, match="is a test of another run"):
        _ = flat.done
    with pytest.raises(RunError, match="is a test of another run"):
        work.read_test(flat, "lanewise")


@pytest.mark.parametrize("summary", [{"episodes": 40}, {"episodes": 40, "controller": "planned"}])
def test_a_summary_that_names_no_run_is_refused(jobs, summary):
    job = jobs["planned, seed 0"]
    sign(job.path / work.TESTS / "lanewise.json", summary=summary)
    with pytest.raises(RunError, match=r"lanewise\.json is damaged; delete it"):
        _ = job.done


def test_settings_of_a_reference_driver_stay_as_they_were_written(jobs, tmp_path):
    """A later version writes the same ones in other bytes; the tests would no longer fit."""
    job = jobs["rule-based, seed 0"]
    file = job.path / work.SETTINGS
    before = dataclasses.replace(job, episodes={"highway-env": 40})
    file.write_text("# from before\n" + file.read_text())
    sign(job.path / work.TESTS / "highway-env.json", run=work._origin(job))
    work.run(before, work.Progress(), OpenFolder(tmp_path))
    assert file.read_text().startswith("# from before")
    assert before.done
