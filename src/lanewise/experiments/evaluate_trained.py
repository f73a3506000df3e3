"""Test a trained controller in either world, with progress; shared by the commands."""

from collections.abc import Callable
from dataclasses import replace

from lanewise import interop
from lanewise.evaluation import drive
from lanewise.evaluation.drive import TestCourse
from lanewise.evaluation.episodes import Episodes, Recording
from lanewise.runs.trained import Trained
from lanewise.system.progress import Progress
from lanewise.training import recipe


def test_course(trained: Trained, renewal: str | None = None) -> TestCourse:
    """The test of a trained controller, with its own settings."""
    return recipe.test_course(trained.settings, trained.name, renewal, trained.parts)


def evaluate(
    trained: Trained,
    world: str,
    episodes: int,
    seed: int,
    reporter: Progress,
    renewal: str | None = None,
) -> Episodes:
    """Drive the test episodes in ``lanewise`` or ``highway-env``."""
    course = test_course(trained, renewal)
    if world == "lanewise":
        reporter.stage(trained.name, episodes)
        return drive.test(course, trained.parameters, seed, episodes, reporter.update)
    twin = interop.twin()
    reporter.stage(f"{trained.name} in highway-env", episodes)
    found: Episodes = twin.test(course, trained.parameters, seed, episodes, reporter.update)
    return found


def record(
    trained: Trained, world: str, seed: int, episode: int, seconds: int | None = None
) -> Recording:
    """Drive one test episode and keep every frame; for so many seconds, if given."""
    if seconds is not None:
        longer = replace(trained.settings.evaluation, duration=seconds)
        trained = replace(trained, settings=replace(trained.settings, evaluation=longer))
    recorder: Callable[..., Recording] = drive.record
    if world == "highway-env":
        recorder = interop.twin().record
    return recorder(test_course(trained), trained.parameters, seed, episode)
