"""Test a trained controller in either world, with progress; shared by the commands."""

from collections.abc import Callable, Mapping
from dataclasses import replace

from lanewise import config, interop
from lanewise.config.settings import Settings, of_test
from lanewise.errors import SettingsError
from lanewise.evaluation import evaluator, stepwise
from lanewise.evaluation.episodes import Episodes, Recording
from lanewise.evaluation.evaluator import EvaluationConfig
from lanewise.evaluation.stepwise import Lanewise, greedy
from lanewise.fields.ranges import show
from lanewise.runs.trained import Trained
from lanewise.system.progress import Progress
from lanewise.training import recipe


def with_changes(
    trained: Trained, changes: Mapping[str, object], tell: Callable[[str], None]
) -> Trained:
    """The controller, to be tested with other settings than its own.

    ``tell`` says which settings differ, and which weights they are of an unfinished run.

    Raises:
        SettingsError: a setting is no test's, is out of range or contradicts another.
    """
    for name in changes:
        if not of_test(name):
            raise SettingsError(f"{name}: a trained controller keeps its own")
    settings = config.replace(trained.settings, changes)
    if trained.note:
        tell(trained.note)
    if trained.parameters and (line := trained_on(trained.settings, settings)):
        tell(f"{trained.name} was {line}")
    return replace(trained, settings=settings)


def trained_on(own: Settings, here: Settings) -> str:
    """What a controller was trained on where its test differs; empty where it does not."""
    found = config.differences([own, here]).items()
    words = (f"{name} {show(ours)} (here {show(other)})" for name, (ours, other) in found)
    return f"trained on {', '.join(words)}" if found else ""


def evaluation_config(trained: Trained, renewal: str | None = None) -> EvaluationConfig:
    """The test of a trained controller, with its own settings."""
    return recipe.evaluation_config(trained.settings, trained.name, renewal, trained.task)


def evaluate(
    trained: Trained,
    world: str,
    episodes: int,
    seed: int,
    reporter: Progress,
    renewal: str | None = None,
) -> Episodes:
    """Drive the test episodes in ``lanewise`` or ``highway-env``."""
    config, done = evaluation_config(trained, renewal), reporter.update
    if world == "lanewise":
        reporter.stage(trained.name, episodes)
        return evaluator.evaluate(config, trained.parameters, seed, episodes, done)
    simulator = interop.evaluation_in_highway_env().HighwayEnv()
    reporter.stage(f"{trained.name} in highway-env", episodes)
    return stepwise.evaluate(config, greedy(trained.parameters), simulator, seed, episodes, done)


def record(
    trained: Trained, world: str, seed: int, episode: int, seconds: int | None = None
) -> Recording:
    """Drive one test episode and keep every frame; for so many seconds, if given."""
    if seconds is not None:
        longer = replace(trained.settings.evaluation, duration=seconds)
        trained = replace(trained, settings=replace(trained.settings, evaluation=longer))
    simulator = Lanewise(size=1)
    if world == "highway-env":
        simulator = interop.evaluation_in_highway_env().HighwayEnv()
    return stepwise.record(
        evaluation_config(trained), greedy(trained.parameters), simulator, seed, episode
    )
