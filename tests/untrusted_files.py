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
import small_runs

from fabricate import make_episodes
from lanewise import config
from lanewise.cli import journal
from lanewise.config.settings import Settings
from lanewise.evaluation.grid import PointResult, Reach
from lanewise.experiments import experiment, jobs, stored_tests
from lanewise.export import contents, formats
from lanewise.runs import checkpoint, pytree_io, run_state, trained
from lanewise.runs.metrics_file import MetricsWriter
from lanewise.runs.run_folder import RunFolder
from lanewise.runs.trained import Trained
from lanewise.system.folder_io import OpenFolder
from lanewise.training import trainer
from lanewise.training.plan import TrainingPlan

FLAGS = small_runs.flags(chunks=5)
WHOLE_SEED, OTHER_SEED = 4, 5
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
    """(folder) -> what was loaded, as plain values that can be compared."""
    signed: bool = True
    """Whether it carries digests; what people write by hand carries none."""


def _plain(value):
    """Arrays as their bytes, so that two loads can be compared bit for bit."""
    if isinstance(value, np.ndarray | jax.Array):
        return (str(value.dtype), value.shape, np.asarray(value).tobytes())
    if isinstance(value, dict):
        return {name: _plain(inner) for name, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(inner) for inner in value]
    if dataclasses.is_dataclass(value):
        return _plain({f.name: getattr(value, f.name) for f in dataclasses.fields(value)})
    return value


def _run(folder):
    return _plain(trained.load(folder / "run"))


def _stopped(folder):
    opened = RunFolder.open(folder / "run")
    state = run_state.read(opened, TrainingPlan.build(opened.settings, opened.controller))
    found = checkpoint.load(opened.checkpoints, state.checkpoint.name)
    told = (opened.settings, opened.seed, opened.controller, state.handed, state.metrics_bytes)
    return _plain((*told, found.tree, found.meta))


def _lines(folder):
    return run_state.training_metrics(RunFolder.open(folder / "run"))


def _policy(folder):
    found = formats.load(folder / "policy.npz")
    return _plain((found.about, found.arrays))


def _settings(folder):
    return config.compose(file=folder / "settings.toml")


def _experiment(folder):
    return _plain(experiment.load_file(folder / "experiment.toml"))


def tested(folder):
    """The job whose test lies in the folder of that target, without a training."""
    return jobs.Job("tested", "hierarchical", False, Settings(), 0, folder, None, {"lanewise": 40})


def _test(folder):
    return _plain(tested(folder).read_test("lanewise"))


def _journal(folder):
    return _plain(journal.read(folder / "progress.jsonl", IDENTITY))


JOURNAL = "journal of a sweep"
TARGETS = (
    Target(
        "finished run",
        ("run/run.json", "run/settings.toml", "run/controller.json", "run/controller.safetensors"),
        _run,
    ),
    Target(
        "stopped run",
        (
            *("run/run.json", "run/stages/step-1.json", "run/stages/step-1.safetensors"),
            "run/metrics.jsonl",
            "run/checkpoints/stage-01-chunk-00000003.json",
            "run/checkpoints/stage-01-chunk-00000003.safetensors",
        ),
        _stopped,
    ),
    Target("metrics of a finished run", ("run/metrics.jsonl",), _lines),
    Target("exported policy, hierarchical", ("policy.npz",), _policy),
    Target("exported policy, planned", ("policy.npz",), _policy),
    Target("settings by hand", ("settings.toml",), _settings, signed=False),
    Target("experiment by hand", ("experiment.toml",), _experiment, signed=False),
    Target("stored test", ("tests/lanewise.json", "tests/lanewise.csv"), _test),
    Target(JOURNAL, ("progress.jsonl",), _journal),
)


def make(place: Path) -> None:
    """Write a folder of each target below ``place / "whole"``, and another of its kind in "other".

    The runs hold zeros in place of what is learnt, which loads just the same.
    """
    for twin, seed in (("whole", WHOLE_SEED), ("other", OTHER_SEED)):
        out = place / twin
        finished, stopped = out / TARGETS[0].name / "run", out / TARGETS[1].name / "run"
        for path in (finished, stopped):
            with RunFolder.create(path, config.compose(flags=FLAGS), "hierarchical", seed) as run:
                _fill(run, path is finished)
        shutil.copytree(finished, out / TARGETS[2].name / "run")
        _policies(out, trained.load(finished))
        for target, file, text in (
            ("settings by hand", "settings.toml", config.dump_toml(config.compose(flags=FLAGS))),
            ("experiment by hand", "experiment.toml", EXPERIMENT),
        ):
            (out / target).mkdir()
            (out / target / file).write_text(text)
        _tested(out / "stored test", seed)
        _sweep(out / JOURNAL / "progress.jsonl", seed)
        shutil.rmtree(finished / "checkpoints", ignore_errors=True)


def _fill(run, whole):
    plan = TrainingPlan.build(run.settings, run.controller)
    counters = dataclasses.asdict(
        trainer.StageCounters(3, 300, 2, (1.5, float(run.seed)), 1, (0.5,), (2,), (0.5,), 2)
    )
    with MetricsWriter(run.metrics) as metrics:
        for number in (1, 2):
            metrics.append(_chunk(number))
        mark = metrics.mark()
    parameters = {}
    for stage in plan.stages if whole else plan.stages[:1]:
        blank = _zeros(plan.weights[stage.name], run.seed)
        run_state.save_stage(run, stage.name, blank, {"counters": counters, **mark})
        parameters |= blank
    if whole:
        return run_state.save_controller(run, parameters)
    arrays = _zeros(pytree_io.shapes(plan.progress(1)), 0)
    meta = {"seed": run.seed, "counters": counters, **mark}
    return checkpoint.save(
        run.checkpoints, checkpoint.checkpoint_name(1, 3), arrays, meta, run.digest
    )


def _zeros(shapes, seed):
    return jax.tree.map(lambda leaf: np.full(leaf.shape, seed, leaf.dtype), shapes)


def _chunk(number):
    figures = dict.fromkeys(("epsilon", "loss", "mean_q", "success_rate", "accident_rate"), 0.25)
    figures |= dict.fromkeys(("reward", "timestep_reward", "speed"), 1.5)
    figures |= {"escape_rate": 0.25}
    counts = dict.fromkeys(("decisions", "episodes", "updates", "transitions"), 100 * number)
    return {"kind": "chunk", "stage": "step-1", "chunk": number, **counts, **figures}


def _policies(out, controller):
    high = {"high_level": controller.parameters["high_level"]}
    planned = Trained("planned", controller.settings, controller.seed, high)
    for each in (controller, planned):
        folder = out / f"exported policy, {each.name}"
        folder.mkdir()
        formats.save(contents.policy(each, "0" * 64), folder / "policy.npz")


def made_up_episodes(seed, count=40):
    return make_episodes(3 * count // 4, count, seed)


def _tested(path, seed):
    path.mkdir()
    (path / stored_tests.SETTINGS).write_text(config.dump_toml(Settings()))
    store_test(tested(path), made_up_episodes(seed))


def store_test(job, episodes, world="lanewise"):
    """Keep a test as that of a job."""
    job.store_test(OpenFolder(job.path), world, episodes, 1.5)


def _sweep(path, seed):
    book = journal.open_(path, IDENTITY if seed == WHOLE_SEED else IDENTITY | {"seed": seed})
    with book.folder, book.file:
        book.add([Reach(True, True, bool(n % 2), "0123" * n, n + seed) for n in range(4)])
        book.add([PointResult(20, 18, 1, 1, 0, 12.5 + n, 9.25 + seed, 19) for n in range(4)])


def fingerprint(value: Any) -> str:
    """What was loaded, as a text."""
    return json.dumps(value, default=repr, sort_keys=True)
