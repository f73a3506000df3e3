"""What an experiment has left on disk, arm by arm and seed by seed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from lanewise.config.settings import Settings
from lanewise.controllers.registry import STEP_1
from lanewise.evaluation import metrics
from lanewise.evaluation.episodes import Recording
from lanewise.evaluation.metrics import Paired
from lanewise.evaluation.settings import WORLDS
from lanewise.experiments import evaluate_trained, published
from lanewise.experiments.experiment import Experiment, ExperimentArm
from lanewise.experiments.jobs import Job
from lanewise.experiments.stored_tests import StoredTest
from lanewise.report.experiment_tables import ArmFigures
from lanewise.runs import metrics_file, run_state, selected_weights
from lanewise.runs.run_folder import RunFolder
from lanewise.runs.selected_weights import SelectedWeights
from lanewise.runs.trained import Trained


@dataclass(frozen=True)
class SeedResult:
    """One finished job."""

    job: Job
    tests: Mapping[str, StoredTest]
    """By world."""

    @cached_property
    def lines(self) -> list[dict[str, Any]]:
        """The metrics of its training; none for a reference driver."""
        if not self.job.trains:
            return []
        return run_state.training_metrics(RunFolder.open(self.job.path))

    @property
    def whole_training(self) -> list[dict[str, Any]]:
        """The metrics of its training, and before them those of a step 1 that it took over."""
        lender = self.job.high_level
        taken = [] if lender is None else run_state.training_metrics(RunFolder.open(lender))
        return [line for line in taken if line["stage"] == STEP_1.name] + self.lines

    @property
    def episodes(self) -> list[dict[str, Any]]:
        """The training episodes of its last stage."""
        return self._of_last_stage("episode")

    @property
    def settled(self) -> float | None:
        """Training episodes of its last stage when epsilon had come down; None if it never did."""
        return metrics_file.settled_episode(self._of_last_stage("chunk"))

    @property
    def selected(self) -> list[SelectedWeights]:
        """What each stage of its own handed on."""
        return selected_weights.of_run(self.lines)

    def _of_last_stage(self, kind: str) -> list[dict[str, Any]]:
        stage = self.lines[-1]["stage"] if self.lines else ""
        return [line for line in self.lines if line["kind"] == kind and line["stage"] == stage]

    @property
    def effort(self) -> dict[str, float]:
        """What its training took, over all its own stages; nothing for a reference driver.

        ``decisions``, completed ``episodes``, ``updates`` of each learner, and ``seconds`` of wall
        time, compilation included.
        """
        if not self.job.trains:
            return {}
        # The last chunk of a stage counts all of the stage.
        last = {line["stage"]: line for line in self.lines if line["kind"] == "chunk"}
        counts = ("decisions", "episodes", "updates")
        times = metrics_file.read(self.job.path / "timings.jsonl")
        return {
            **{name: sum(chunk[name] for chunk in last.values()) for name in counts},
            "seconds": sum(line["seconds"] for line in times),
        }

    @property
    def trained_by(self) -> Mapping[str, Any] | None:
        """The code its run was made with; None for a reference driver."""
        return RunFolder.open(self.job.path).source if self.job.trains else None

    @cached_property
    def paired(self) -> Paired | None:
        """The same starts in both worlds; None where it was tested in one alone."""
        if len(self.tests) < len(WORLDS):
            return None
        return metrics.paired(*(self.tests[world].episodes for world in WORLDS))

    @cached_property
    def controller(self) -> Trained:
        """The controller that was tested."""
        return self.job.load()

    def record(self, episode: int = 0, seconds: int | None = None) -> Recording:
        """A test episode in our world, driven once more with every frame kept."""
        return evaluate_trained.record(self.controller, "lanewise", self.job.seed, episode, seconds)


@dataclass(frozen=True)
class ArmResult:
    """An arm with all its finished seeds."""

    arm: ExperimentArm
    seeds: tuple[SeedResult, ...]

    @property
    def settings(self) -> Settings:
        """Of all its seeds."""
        return self.seeds[0].job.settings

    @cached_property
    def figures(self) -> ArmFigures:
        """What tables need of it."""
        unlike = published.unlike_test(self.settings)
        trained = [seed for seed in self.seeds if seed.job.trains]
        return ArmFigures(
            title=self.arm.title,
            controller=self.arm.controller,
            seeds=[seed.job.seed for seed in self.seeds],
            tests={
                world: [
                    replace(seed.tests[world].summary, unlike_paper=unlike)
                    for seed in self.seeds
                    if world in seed.tests
                ]
                for world in WORLDS
            },
            training=[seed.episodes for seed in trained],
            effort=[seed.effort for seed in trained],
            unlike_paper=unlike,
            unlike_papers_training=published.unlike_training(self.settings),
        )


def collect(experiment: Experiment, jobs: Sequence[Job]) -> list[ArmResult]:
    """The finished jobs by arm; arms with none are left out."""
    found = []
    for arm in experiment.arms:
        done = [job for job in jobs if job.arm == arm.name and job.done]
        if done:
            found.append(ArmResult(arm, tuple(map(_result, done))))
    return found


def _result(job: Job) -> SeedResult:
    tests = {world: job.read_test(world) for world in job.episodes}
    return SeedResult(job, {world: test for world, test in tests.items() if test is not None})
