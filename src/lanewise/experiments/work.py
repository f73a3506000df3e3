"""One arm with one seed: train it or continue, then test it in both worlds. Files, no report."""

import hashlib
import json
import math
import os
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from lanewise import config, reading, version
from lanewise.config.settings import Settings
from lanewise.controllers.registry import STEP_1
from lanewise.errors import LanewiseError, RunError
from lanewise.evaluation import metrics
from lanewise.evaluation.episodes import Episodes
from lanewise.evaluation.metrics import Summary
from lanewise.experiments import origin, testing
from lanewise.progress import Progress
from lanewise.report import provenance
from lanewise.runs import trained
from lanewise.runs.files import OpenFolder, write_atomically
from lanewise.runs.folder import LARGEST_SETTINGS, RunFolder
from lanewise.runs.train import train
from lanewise.runs.trained import Trained

SETTINGS = "settings.toml"
"""What a reference driver was tested with; a training has its own in its run folder."""
TESTS = "tests"
"""Folder of a run that holds its tests."""
_LARGEST_TABLE, _LARGEST_SUMMARY = 64_000_000, 100_000
"""Bytes of a test's episodes and of what is said of them."""
_LONGEST = 1e9
"""Seconds of a test, 30 years."""
_FORMAT, _VERSION = "lanewise-test", 1
"""Which a stored test need not say."""
_FIELDS = {
    *("summary", "seconds", "run", "episodes_sha256", "digest"),
    *(*version.SOURCE, "versions", "machine"),
}
_AGAIN = "; delete it, and the test is driven again"


@dataclass(frozen=True)
class Job:
    """An arm with a seed."""

    arm: str
    controller: str
    """What is trained, or a reference driver."""
    trains: bool
    """Whether there is anything to train."""
    settings: Settings
    seed: int
    """Of the training, and of the test starts."""
    path: Path
    """Run folder."""
    high_level: Path | None
    """Run whose step 1 is taken over."""
    episodes: dict[str, int]
    """Test episodes by world; worlds with none are left out."""

    @property
    def label(self) -> str:
        """How people call it."""
        return f"{self.arm}, seed {self.seed}"

    @property
    def done(self) -> bool:
        """Whether nothing of it is left to do."""
        return all(is_tested(self, world, n) for world, n in self.episodes.items())


@dataclass(frozen=True)
class Test:
    """What a test left on disk."""

    summary: Summary
    episodes: Episodes
    seconds: float
    """Wall time of the test."""


def check(job: Job) -> None:
    """Refuses a run folder that was made with other settings.

    Raises:
        RunError: says which differ; or they are damaged, or a link.
        SettingsError: what a reference driver was tested with are no settings.
    """
    if (job.path / "run.json").exists():
        RunFolder.resume(job.path, job.settings, job.controller, job.seed).close()
    elif not job.trains and os.path.lexists(file := job.path / SETTINGS):
        try:
            data = reading.contents(file, LARGEST_SETTINGS, links=False)
        except reading.UnreadableError as error:
            raise RunError(f"cannot read {file}: {error}; choose another folder") from error
        difference = config.first_difference(config.compose(file=file, data=data), job.settings)
        if difference:
            raise RunError(f"{job.path} was tested with other settings: there {difference}")


def run(job: Job, reporter: Progress, out: OpenFolder) -> dict[str, float]:
    """Do what is left of a job.

    Args:
        job: below ``out``.
        reporter: told how far it is.
        out: the experiment's folder.

    Returns:
        The seconds each part took now.

    Raises:
        RunError: the run is of something else, or damaged; or the experiment's folder was moved,
            removed or replaced meanwhile.
    """
    times = {}
    with out.inside(job.path.relative_to(out.path)) as place:
        if job.trains:
            with _folder(job, place) as folder:
                if not trained.is_finished(folder):
                    began = time.monotonic()
                    # A run that was stopped after it took over step 1 has it already.
                    taken = trained.has_stage(folder, STEP_1.name)
                    train(folder, None if taken else job.high_level, reporter)
                    times[f"train {job.label}"] = time.monotonic() - began
            controller = trained.load(job.path)
        else:
            check(job)
            # Tests remember the file's digest, so that one with the same settings stays as it is.
            if not (job.path / SETTINGS).exists():
                write_atomically(place, {SETTINGS: config.dump_toml(job.settings).encode()})
            controller = Trained(job.controller, job.settings, job.seed, {})
        for world, count in job.episodes.items():
            if not is_tested(job, world, count):
                began = time.monotonic()
                episodes = testing.test(controller, world, count, job.seed, reporter)
                seconds = time.monotonic() - began
                times[f"test {job.label} in {world}"] = seconds
                place.require_same()
                _store(place, controller.name, world, episodes, seconds, _origin(job))
    return times


def _folder(job: Job, place: OpenFolder) -> RunFolder:
    """The run's folder, to be continued or new."""
    if (job.path / "run.json").exists():
        return RunFolder.resume(place, job.settings, job.controller, job.seed)
    return RunFolder.create(place, job.settings, job.controller, job.seed)


def is_tested(job: Job, world: str, count: int) -> bool:
    """Whether a run has a test of that many episodes.

    Raises:
        RunError: what it has is damaged, is the test of another run, or its folder is a link.
    """
    file = _tests_of(job.path) / f"{world}.json"
    return file.exists() and _read_of(job, file)["summary"]["episodes"] == count


def read_test(job: Job, world: str) -> Test | None:
    """A stored test, None where there is none.

    Raises:
        RunError: its files are damaged or of another run, or their folder is a link.
    """
    file = _tests_of(job.path) / f"{world}.json"
    if not os.path.lexists(file):
        return None
    stored = _read_of(job, file)
    table = file.with_suffix(".csv")
    content = _contents(table, _LARGEST_TABLE)
    # Tests from before the digest was remembered lack it.
    if _sha256(content) != stored.get("episodes_sha256", _sha256(content)):
        raise RunError(f"{table} was altered{_AGAIN}")
    try:
        episodes = metrics.from_csv(content.decode("utf-8"))
        summary = Summary.from_json(stored["summary"])
        again = metrics.summarise(episodes, controller=summary.controller, world=world)
    except (LanewiseError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise RunError(f"{table} is damaged{_AGAIN}") from error
    # The figures follow from the episodes: if one of the two was altered, they no longer do.
    if not _agree(summary.to_json(), again.to_json()):
        raise RunError(f"{file} and {table.name} do not agree{_AGAIN}")
    # An older summary lacks newer metrics; the episodes have them.
    values = {**again.values, **summary.values}
    intervals = {**again.intervals, **summary.intervals}
    whole = replace(summary, values=values, intervals=intervals)
    return Test(whole, episodes, stored["seconds"])


def _agree(stored: Any, again: Any) -> bool:
    """Whether two summaries are the same, up to how another machine rounds."""
    if isinstance(again, dict):
        return isinstance(stored, dict) and all(
            _agree(value, again.get(name)) for name, value in stored.items()
        )
    if isinstance(again, list | tuple):
        return len(stored) == len(again) and all(map(_agree, stored, again))
    if isinstance(again, float):
        return isinstance(stored, float) and math.isclose(stored, again, rel_tol=1e-9, abs_tol=1e-9)
    return bool(stored == again)


def _origin(job: Job) -> dict[str, Any]:
    """What a test of the job remembers of its run."""
    weights = trained.CONTROLLER if job.trains else None
    return origin.of(job.path, SETTINGS, job.seed, weights)


def _store(
    place: OpenFolder,
    name: str,
    world: str,
    episodes: Episodes,
    seconds: float,
    run: dict[str, Any],
) -> None:
    """Keep a test in its run's folder."""
    summary = metrics.summarise(episodes, controller=name, world=world).to_json()
    table = metrics.to_csv(episodes).encode()
    stored: dict[str, Any] = {
        "summary": summary,
        "seconds": round(seconds, 2),
        "run": run,
        **provenance.source(),
        "versions": provenance.versions(),
        "machine": provenance.machine(),
        "episodes_sha256": _sha256(table),
    }
    text = json.dumps(stored | {"digest": reading.digest(stored)}, indent=1) + "\n"
    _tests_of(place.path)
    with place.inside(TESTS) as folder:
        write_atomically(folder, {f"{world}.csv": table, f"{world}.json": text.encode()})


def _tests_of(path: Path) -> Path:
    """The folder of a run's tests, there or not.

    Raises:
        RunError: it is a link, and leads to where they do not belong, or no folder.
    """
    folder = path / TESTS
    try:
        reading.require_plain(folder, folder=True)
    except reading.UnreadableError as error:
        raise RunError(f"cannot use {folder}: {error}{_AGAIN}") from error
    return folder


def _read_of(job: Job, file: Path) -> dict[str, Any]:
    """What a test left, once it is sure that it is one of this job."""
    stored = _read(file)
    try:
        # Tests from before remember nothing of their run.
        run = _origin(job) if "run" in stored else None
        fits = origin.fits(stored, run, job.controller, file.stem)
    except (KeyError, TypeError) as error:
        raise RunError(f"{file} is damaged{_AGAIN}") from error
    except LanewiseError as error:
        raise RunError(f"{file} cannot be told to be a test of its run: {error}{_AGAIN}") from error
    if not fits:
        raise RunError(f"{file} is a test of another run{_AGAIN}")
    return stored


def _read(file: Path) -> dict[str, Any]:
    try:
        stored: dict[str, Any] = reading.json_value(_contents(file, _LARGEST_SUMMARY))
        if other := reading.other_format(stored, _FORMAT, _VERSION):
            raise RunError(f"{file} {other}")
        counts = type(stored["summary"]["episodes"]) is int
        if not counts or type(stored["seconds"]) not in (int, float):
            raise ValueError("no numbers")
        if not 0 <= stored["seconds"] < _LONGEST:
            raise ValueError("no time that a test could take")
        if ("digest" in stored) != ("episodes_sha256" in stored):
            raise ValueError("altered")
        version.remembered(stored)
        if stored.keys() - _FIELDS or stored.get("digest", reading.digest(stored)) != (
            reading.digest(stored)
        ):
            raise ValueError("altered")
    except (ValueError, KeyError, TypeError) as error:
        raise RunError(f"{file} is damaged{_AGAIN}") from error
    return stored


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _contents(file: Path, largest: int) -> bytes:
    try:
        return reading.contents(file, largest, links=False)
    except reading.UnreadableError as error:
        raise RunError(f"cannot read {file}: {error}{_AGAIN}") from error
