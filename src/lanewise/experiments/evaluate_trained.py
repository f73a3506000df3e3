"""Test a trained controller in either world, with progress; shared by the commands."""

from dataclasses import replace

from lanewise import interop
from lanewise.evaluation import evaluator, stepwise
from lanewise.evaluation.episodes import Episodes, Recording
from lanewise.evaluation.evaluator import EvaluationConfig
from lanewise.evaluation.stepwise import Lanewise, greedy
from lanewise.runs.trained import Trained
from lanewise.system.progress import Progress
from lanewise.training import recipe


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
