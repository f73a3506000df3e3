"""What an experiment has left on disk, arm by arm and seed by seed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from lanewise.controllers.registry import STEP_1
from lanewise.evaluation.episodes import Recording
from lanewise.experiments import testing, work
from lanewise.experiments.experiment import Arm, Experiment
from lanewise.experiments.folder import RUNS
from lanewise.experiments.work import Job, Test
from lanewise.runs import kept, metrics, trained
from lanewise.runs.folder import RunFolder
from lanewise.runs.kept import Kept
from lanewise.runs.trained import Trained


@dataclass(frozen=True)
class Effort:
    """What a training took, over all its stages; what was taken over is not part of it."""

    decisions: int
    episodes: int
    """Completed ones."""
    updates: int
    """Of the learners; where two levels learn, of each."""
    seconds: float
    """Wall time, compilation included."""


@dataclass(frozen=True)
class SeedResult:
    """One finished job."""

    job: Job
    tests: Mapping[str, Test]
    """By world."""

    @cached_property
    def lines(self) -> list[dict[str, Any]]:
        """The metrics of its training; none for a reference driver."""
        return trained.lines(RunFolder.open(self.job.path)) if self.job.trains else []

    @property
    def whole_training(self) -> list[dict[str, Any]]:
        """The metrics of its training, and before them those of a step 1 that it took over."""
        lender = self.job.high_level
        taken = [] if lender is None else trained.lines(RunFolder.open(lender))
        return [line for line in taken if line["stage"] == STEP_1.name] + self.lines

    @property
    def episodes(self) -> list[dict[str, Any]]:
        """The training episodes of its last stage."""
        return self._of_last_stage("episode")

    @property
    def chunks(self) -> list[dict[str, Any]]:
        """The chunks of its last stage."""
        return self._of_last_stage("chunk")

    @property
    def kept(self) -> list[Kept]:
        """What each stage of its own handed on."""
        return kept.of_run(self.lines)

    def _of_last_stage(self, kind: str) -> list[dict[str, Any]]:
        stage = self.lines[-1]["stage"] if self.lines else ""
        return [line for line in self.lines if line["kind"] == kind and line["stage"] == stage]

    @property
    def effort(self) -> Effort | None:
        """What its training took; None for a reference driver."""
        if not self.job.trains:
            return None
        # The last chunk of a stage counts all of the stage.
        last = {line["stage"]: line for line in self.lines if line["kind"] == "chunk"}
        times = metrics.read(self.job.path / "timings.jsonl")
        return Effort(
            decisions=sum(chunk["decisions"] for chunk in last.values()),
            episodes=sum(chunk["episodes"] for chunk in last.values()),
            updates=sum(chunk["updates"] for chunk in last.values()),
            seconds=sum(_seconds(line) for line in times),
        )

    @property
    def trained_by(self) -> Mapping[str, Any] | None:
        """The code its run was made with, empty in older runs; None for a reference driver."""
        return RunFolder.open(self.job.path).source if self.job.trains else None

    @property
    def controller(self) -> Trained:
        """The controller that was tested."""
        if self.job.trains:
            return trained.load(self.job.path)
        return Trained(self.job.controller, self.job.settings, self.job.seed, {})

    def record(self, episode: int = 0, seconds: int | None = None) -> Recording:
        """A test episode in our world, driven once more with every frame kept; see `testing`."""
        return testing.record(self.controller, "lanewise", self.job.seed, episode, seconds)


@dataclass(frozen=True)
class ArmResult:
    """An arm with all its finished seeds."""

    arm: Arm
    seeds: tuple[SeedResult, ...]

    def tests(self, world: str) -> list[Test]:
        """The tests of all seeds in a world, in their order."""
        return [seed.tests[world] for seed in self.seeds if world in seed.tests]


def jobs(
    experiment: Experiment,
    out: Path,
    first_seed: int,
    trap: str,
    overrides: Mapping[str, object],
) -> list[Job]:
    """Every job of an experiment, seed by seed within each arm.

    Args:
        experiment: arms and seeds.
        out: its folder.
        first_seed: the first of its seeds.
        trap: scenario preset.
        overrides: settings of the user's, by dotted name; they win over the arms'.
    """
    found = []
    for arm in experiment.arms:
        settings = experiment.settings(arm, trap, overrides)
        for seed in range(first_seed, first_seed + experiment.count(arm, "seeds")):
            episodes = {
                "lanewise": experiment.count(arm, "episodes"),
                "highway-env": experiment.count(arm, "highway_env_episodes"),
            }
            found.append(
                Job(
                    arm=arm.name,
                    controller=arm.controller,
                    trains=arm.trained,
                    settings=settings,
                    seed=seed,
                    path=_path(out, arm.name, seed),
                    high_level=_path(out, arm.high_level, seed) if arm.high_level else None,
                    episodes={world: count for world, count in episodes.items() if count},
                )
            )
    return found


def collect(experiment: Experiment, jobs: Sequence[Job]) -> list[ArmResult]:
    """The finished jobs by arm; arms with none are left out."""
    found = []
    for arm in experiment.arms:
        seeds = tuple(
            SeedResult(job, _tests(job)) for job in jobs if job.arm == arm.name and job.done
        )
        if seeds:
            found.append(ArmResult(arm, seeds))
    return found


def _tests(job: Job) -> dict[str, Test]:
    tests = {world: work.read_test(job, world) for world in job.episodes}
    return {world: test for world, test in tests.items() if test is not None}


def _seconds(line: Mapping[str, Any]) -> float:
    value = line.get("seconds")
    return value if isinstance(value, int | float) else 0.0


def _path(out: Path, arm: str, seed: int) -> Path:
    return out / RUNS / arm / f"seed-{seed}"
