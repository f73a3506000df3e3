"""The main job, end to end, at the smallest size that is still the paper's test."""

import json
import os
import shutil
import subprocess
import sys

import pytest
import small_runs

from lanewise.cli.main import main
from lanewise.experiments import drives, experiment, schedule
from lanewise.report import provenance
from lanewise.system import folder_io, version

TINY = [
    *("--episodes", "3", "--highway-env-episodes", "1"),
    *("--evaluation.validation-episodes", "2", "--planner.preview", "2"),
]
for stage in ("high-level", "low-level"):
    TINY += [f"--{stage}.decisions", "100", f"--{stage}.worlds", "2"]
    TINY += [f"--{stage}.learner.hidden", "8", "8", f"--{stage}.learner.warm-up", "50"]


def words(out, arm="hierarchical"):
    return ["reproduce", "--out", str(out), "--only", arm, *TINY]


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    out = tmp_path_factory.mktemp("reproduce") / "out"
    command = [sys.executable, "-m", "lanewise", *words(out)]
    # No bit of its figures matters here, and it compiles for longer than it runs.
    quicker = os.environ | {"JAX_DISABLE_MOST_OPTIMIZATIONS": "1"}
    return out, subprocess.run(command, capture_output=True, text=True, check=False, env=quicker)


@pytest.mark.slow
def test_it_prints_the_papers_table_with_ours_beside_it_and_leaves_a_report(done):
    out, result = done
    assert result.returncode == 0, result.stderr
    for figure in ("13.20", "97.67", "331.6"):
        assert figure in result.stdout
    assert "starts end alike in both worlds" in result.stdout
    assert "[hierarchical, seed 0] step-2: 100%" in result.stderr
    assert "[1/1]" in result.stderr
    report, page = json.loads((out / "report.json").read_text()), (out / "report.md").read_text()
    assert page.count("|") > 50
    for name in ("curves.png", "curves.svg", "clip.gif"):
        assert (out / name).stat().st_size > 1000
    (arm,) = report["arms"]
    (seed,) = arm["seeds"]
    assert arm["median_seed"] == seed["seed"]
    driven = drives.read(out / "drives" / "hierarchical.npz")
    assert len(driven) == drives.EPISODES
    assert {drive.controller for drive in driven} == {"hierarchical"}
    assert seed["weights"][-1]["stage"] == "step-2"
    assert "## Kept and last weights" in page
    assert seed["trained_by"] == version.source()
    made = page.partition("## How it was made")[2]
    assert f"\n\n{provenance.trained_by([seed['trained_by']])}\n\n" in made


def test_a_folder_in_use_is_refused(tmp_path, refused):
    with folder_io.lock(tmp_path / "out", "reproducing"):
        said = refused(*words(tmp_path / "out"))
    assert "is in use: another process is reproducing in it" in said


@pytest.mark.slow
def test_a_complete_folder_and_arms_of_another_trap_are_refused(
    done, unoptimised, tmp_path, refused
):
    """Also arms that are not asked for: the report speaks of all arms in the folder."""
    out, _ = done
    before = (out / "report.md").read_bytes()
    assert "is complete: see" in refused(*words(out))
    assert (out / "report.md").read_bytes() == before
    folder = tmp_path / "out"
    shutil.copytree(out / "runs" / "hierarchical", folder / "runs" / "hierarchical")
    shutil.copy(out / experiment.FILE, folder)
    said = refused(*words(folder, "single-level"), "--trap", "trap-10.9")
    assert "hierarchical/seed-0 was made with other settings: there scenario.trap_speed" in said
    assert not (folder / "runs" / "single-level").exists()


@pytest.mark.slow
def test_a_report_that_lacks_what_is_to_be_done_goes_first(
    done, unoptimised, tmp_path, monkeypatch
):
    """Else an interruption would leave a folder that looks complete."""
    folder = shutil.copytree(done[0], tmp_path / "out")
    monkeypatch.setattr(schedule, "run", small_runs.stop)
    for _ in range(2):
        assert main([*words(folder), "--seeds", "2"]) == 130
        assert not (folder / "report.md").exists()
