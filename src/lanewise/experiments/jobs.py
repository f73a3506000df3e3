"""The jobs of an experiment: an arm with a seed, trained and then tested in both worlds."""

import os
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from lanewise import config
from lanewise.config.settings import Settings
from lanewise.controllers.registry import STEP_1
from lanewise.errors import RunError
from lanewise.evaluation.episodes import Episodes
from lanewise.evaluation.settings import WORLDS
from lanewise.experiments import evaluate_trained, stored_tests
from lanewise.experiments.experiment import RUNS, Experiment, ExperimentArm
from lanewise.experiments.stored_tests import SETTINGS, StoredTest
from lanewise.runs import run_state, trained
from lanewise.runs.run_folder import CONTROLLER, LARGEST_SETTINGS, RunFolder
from lanewise.runs.trained import Trained
from lanewise.runs.training_loop import train
from lanewise.system import safe_io
from lanewise.system.folder_io import OpenFolder, write_atomically
from lanewise.system.progress import Progress
from lanewise.training.plan import TrainingPlan


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
        """What people call it."""
        return f"{self.arm}, seed {self.seed}"

    @property
    def done(self) -> bool:
        """Whether nothing of it is left to do; errors as for `read_test`."""
        return all(self.is_tested(world) for world in self.episodes)

    def is_tested(self, world: str) -> bool:
        """Whether it has a stored test of as many episodes as are wanted; errors likewise."""
        test = self.read_test(world)
        return test is not None and len(test.episodes) == self.episodes[world]

    def read_test(self, world: str) -> StoredTest | None:
        """Its stored test in a world, None without one.

        Raises:
            RunError: the test is damaged or of another run.
        """
        return stored_tests.read(self.path, self.controller, world, self.seed, self._weights)

    def store_test(self, place: OpenFolder, world: str, episodes: Episodes, seconds: float) -> None:
        """Keep its test in a world, which took so many seconds; ``place`` is its run folder."""
        run = (self.seed, self._weights)
        stored_tests.store(place, self.controller, world, episodes, seconds, *run)

    def load(self) -> Trained:
        """What it trained, or its reference driver."""
        if self.trains:
            return trained.load(self.path)
        return Trained(self.controller, self.settings, self.seed, {})

    @property
    def _weights(self) -> str | None:
        """File name of what it trained."""
        return CONTROLLER if self.trains else None


def of_experiment(
    experiment: Experiment,
    out: Path,
    first_seed: int,
    trap: str,
    overrides: Mapping[str, object],
) -> list[Job]:
    """Every job of an experiment, seed by seed within each arm.

    ``trap`` and the user's ``overrides`` are as of `Experiment.settings`.
    """

    def path(arm: str, seed: int) -> Path:
        return out / RUNS / arm / f"seed-{seed}"

    return [
        Job(
            arm=arm.name,
            controller=arm.controller,
            trains=arm.trained,
            settings=experiment.settings(arm, trap, overrides),
            seed=seed,
            path=path(arm.name, seed),
            high_level=path(arm.high_level, seed) if arm.high_level else None,
            episodes=_episodes(arm),
        )
        for arm in experiment.arms
        for seed in range(first_seed, first_seed + arm.seeds)
    ]


def _episodes(arm: ExperimentArm) -> dict[str, int]:
    counts = zip(WORLDS, (arm.episodes, arm.highway_env_episodes), strict=True)
    return {world: count for world, count in counts if count}


def check(job: Job) -> None:
    """Refuse a run folder that was made with other settings.

    Raises:
        LanewiseError: says which differ; or the settings are damaged, or a link.
    """
    if (job.path / "run.json").exists():
        RunFolder.resume(job.path, job.settings, job.controller, job.seed).close()
    elif not job.trains and os.path.lexists(file := job.path / SETTINGS):
        data = safe_io.read_bytes(file, LARGEST_SETTINGS, links=False)
        difference = config.first_difference(config.compose(file=file, data=data), job.settings)
        if difference:
            raise RunError(f"{job.path} was tested with other settings: there {difference}")


def run(job: Job, reporter: Progress, out: OpenFolder) -> dict[str, float]:
    """Do what is left of a job in the experiment's folder.

    Returns:
        The seconds each part took now.

    Raises:
        RunError: the run is of something else, or damaged; or the experiment's folder was moved,
            removed or replaced meanwhile.
    """
    times = {}
    with out.inside(job.path.relative_to(out.path)) as place:
        began = time.monotonic()
        if job.trains and _train(job, place, reporter):
            times[f"train {job.label}"] = time.monotonic() - began
        if not job.trains:
            check(job)
            # Tests remember the file's digest, so a file with the same settings stays as it is.
            if not (job.path / SETTINGS).exists():
                write_atomically(place, {SETTINGS: config.dump_toml(job.settings).encode()})
        controller = job.load()
        for world, count in job.episodes.items():
            if job.is_tested(world):
                continue
            began = time.monotonic()
            episodes = evaluate_trained.evaluate(controller, world, count, job.seed, reporter)
            seconds = times[f"test {job.label} in {world}"] = time.monotonic() - began
            place.require_same()
            job.store_test(place, world, episodes, seconds)
    return times


def _train(job: Job, place: OpenFolder, reporter: Progress) -> bool:
    """Train, from the start or on; returns whether anything was left to do."""
    begin = RunFolder.resume if (job.path / "run.json").exists() else RunFolder.create
    with begin(place, job.settings, job.controller, job.seed) as folder:
        if run_state.is_finished(folder):
            return False
        # A run that was stopped after it took over step 1 has it already.
        lender = None if run_state.has_stage(folder, STEP_1.name) else job.high_level
        plan = TrainingPlan.build(folder.settings, folder.controller)
        train(folder, plan, reporter, high_level=lender)
    return True
