"""Whole files of every kind that people pass on, each with the function that loads it."""

import dataclasses
import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import numpy as np

from fabricate import make_episodes
from lanewise import config
from lanewise.cli import journal
from lanewise.config.settings import Settings
from lanewise.evaluation.cells import KINDS, CellOutcome, Reach
from lanewise.experiments import experiment, jobs, stored_tests
from lanewise.export import contents, formats
from lanewise.export.policy_file import PolicyFile
from lanewise.runs import pytree_io, run_state, trained
from lanewise.runs.run_folder import RunFolder
from lanewise.system.folder_io import OpenFolder
from lanewise.training.plan import TrainingPlan

IDENTITY = {"kind": "Sweep", "controller": "hierarchical", "weights": "0" * 64, "seed": 0}
EXPERIMENT = """title = "Two arms"
preset = "quick"
seeds = 2
episodes = 30
highway_env_episodes = 10
[arms.planned]
title = "step 1"
controller = "planned"
[arms.hierarchical]
title = "both steps"
controller = "hierarchical"
high_level = "planned"
[arms.hierarchical.settings]
"low_level.tracking_weight" = 0.5
"""


@dataclass(frozen=True)
class Target:
    """A kind of file, or of folder, that people load."""

    name: str
    files: tuple[str, ...]
    """Within its folder."""
    load: Callable[[Path], Any]
    """(folder) -> what was loaded."""
    signed: bool = True
    """Whether it carries digests; what people write by hand carries none."""


def _stopped(folder):
    run = RunFolder.open(folder / "run")
    state = run_state.read(run, TrainingPlan.build(run.settings, run.controller))
    found = state.checkpoint
    told = (run.settings, run.seed, run.controller, state.handed, state.metrics_bytes)
    return (*told, pytree_io.flatten(found.tree), found.meta)


def tested(folder):
    """The job whose test lies in the folder of that target, without a training."""
    return jobs.Job("tested", "hierarchical", False, Settings(), 0, folder, None, {"lanewise": 40})


def _policy(folder):
    found = PolicyFile.open(folder / "policy.npz").policy
    return found.about, found.arrays


FINISHED, STOPPED, METRICS = "finished run", "stopped run", "metrics of a finished run"
UNFINISHED = "weights of a stopped run"
POLICY, BY_HAND, OWN_EXPERIMENT = "exported policy", "settings by hand", "experiment by hand"
TEST, JOURNAL = "stored test", "journal of a sweep"
NEWEST = "run/checkpoints/stage-01-chunk-00000003"
TARGETS = (
    Target(
        FINISHED,
        ("run/run.json", "run/settings.toml", "run/controller.json", "run/controller.safetensors"),
        lambda folder: trained.load(folder / "run"),
    ),
    Target(
        STOPPED,
        (
            *("run/run.json", "run/stages/step-1.json", "run/stages/step-1.safetensors"),
            *("run/metrics.jsonl", f"{NEWEST}.json", f"{NEWEST}.safetensors"),
        ),
        _stopped,
    ),
    Target(
        UNFINISHED,
        (f"{NEWEST}.json", f"{NEWEST}.safetensors"),
        lambda folder: trained.load(folder / f"{NEWEST}.json").parameters,
    ),
    Target(
        METRICS,
        ("run/metrics.jsonl",),
        lambda folder: run_state.training_metrics(RunFolder.open(folder / "run")),
    ),
    Target(POLICY, ("policy.npz",), _policy),
    Target(
        BY_HAND,
        ("settings.toml",),
        lambda folder: config.compose(file=folder / "settings.toml"),
        signed=False,
    ),
    Target(
        OWN_EXPERIMENT,
        ("experiment.toml",),
        lambda folder: experiment.load_file(folder / "experiment.toml"),
        signed=False,
    ),
    Target(
        TEST,
        ("tests/lanewise.json", "tests/lanewise.csv"),
        lambda folder: tested(folder).read_test("lanewise"),
    ),
    Target(
        JOURNAL,
        ("progress.json",),
        lambda folder: journal.read(folder / "progress.json", IDENTITY),
    ),
)


def make(out: Path, whole: Path, stopped: Path) -> None:
    """Write a folder of each target, from a finished run and one that was stopped in step 2."""
    for name, run in zip(
        (FINISHED, STOPPED, UNFINISHED, METRICS), (whole, stopped, stopped, whole), strict=True
    ):
        shutil.copytree(run, out / name / "run")
    for file in (out / STOPPED).glob("run/checkpoints/*"):
        if not file.match(f"{NEWEST}.*"):
            file.unlink()  # it would be fallen back to
    for name in (POLICY, BY_HAND, OWN_EXPERIMENT, TEST):
        (out / name).mkdir()
    formats.save(contents.policy(trained.load(whole), "0" * 64), out / POLICY / "policy.npz")
    (out / BY_HAND / "settings.toml").write_text(config.dump_toml(Settings()))
    (out / OWN_EXPERIMENT / "experiment.toml").write_text(EXPERIMENT)
    (out / TEST / stored_tests.SETTINGS).write_text(config.dump_toml(Settings()))
    store_test(tested(out / TEST), made_up_episodes(0))
    book = journal.open_(out / JOURNAL / "progress.json", IDENTITY)
    with book.folder:
        book.add([Reach(True, True, bool(n % 2), "0123" * n, n) for n in range(4)])
        kinds = [1] * len(KINDS)
        book.add([CellOutcome(20, 12.5 + n, 9.25, [9], [8], [kinds], [3]) for n in range(4)])


def made_up_episodes(seed, count=40):
    return make_episodes(3 * count // 4, count, seed)


def store_test(job, episodes, world="lanewise"):
    """Keep a test as that of a job."""
    job.store_test(OpenFolder(job.path), world, episodes, 1.5)


def fingerprint(value: Any) -> str:
    """What was loaded, as a text that differs where a bit does."""
    return json.dumps(value, default=_plain, sort_keys=True)


def _plain(value):
    if isinstance(value, np.ndarray | jax.Array):
        return [str(value.dtype), value.shape, np.asarray(value).tobytes().hex()]
    return vars(value) if dataclasses.is_dataclass(value) else repr(value)
