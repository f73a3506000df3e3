"""Test a trained controller in either world, with progress; shared by the commands."""

from collections.abc import Callable, Mapping
from dataclasses import replace

from lanewise import config, interop
from lanewise.config.settings import Settings, of_test
from lanewise.controllers.registry import CONTROLLERS
from lanewise.errors import SettingsError
from lanewise.evaluation import evaluator, stepwise
from lanewise.evaluation.episodes import Episodes, Recording
from lanewise.evaluation.evaluator import EvaluationConfig
from lanewise.evaluation.stepwise import Lanewise, Simulator, StepPolicy, greedy
from lanewise.fields.ranges import show
from lanewise.runs.trained import Trained
from lanewise.system.progress import Progress
from lanewise.training import recipe
from lanewise.world.state import RULE_BASED


def with_changes(
    trained: Trained, changes: Mapping[str, object], tell: Callable[[str], None]
) -> Trained:
    """The controller, to be tested with other settings than its own.

    ``tell`` says which settings differ, and which weights they are of an unfinished run.

    Raises:
        SettingsError: a setting is no test's, is out of range or contradicts another; or the
            controller cannot drive with its `Trained.task`.
    """
    for name in changes:
        if not of_test(name):
            raise SettingsError(f"{name}: a trained controller keeps its own")
    settings = config.replace(trained.settings, changes)
    if trained.note:
        tell(trained.note)
    if line := trained_on(trained, settings):
        tell(f"{trained.name} was {line}")
    changed = replace(trained, settings=settings)
    _check_task(changed)
    return changed


def trained_on(trained: Trained, here: Settings) -> str:
    """What a controller was trained and validated on where its test differs; empty if nowhere.

    Args:
        trained: with the settings of its training, and the functions of its test.
        here: the settings of its test.
    """
    if trained.feature_count is None:
        return ""
    found = {
        name: [show(value) for value in values]
        for name, values in config.differences([trained.settings, here]).items()
    }
    there, now = (
        dict(each.split(": ", 1) for each in names)
        for names in (trained.trained_with, trained.task.names())
    )
    found |= {
        part: [own.get(part, "the paper's") for own in (there, now)]
        for part in {**there, **now}
        if there.get(part) != now.get(part)
    }
    lasts = found.pop("evaluation.duration", None)
    words = ", ".join(f"{name} {own} (here {other})" for name, (own, other) in found.items())
    parts = [f"trained on {words}"] if words else []
    if lasts:
        parts.append("validated for {} s (here {})".format(*lasts))
    return " and ".join(parts)


def _check_task(trained: Trained) -> None:
    """Refuse functions with which a controller cannot drive."""
    task, test = trained.task, evaluation_config(trained)
    observes = trained.feature_count
    if observes is not None and observes != test.controller.levels[0].feature_count:
        seen = task.validate(test.scenario, test.driving)
        raise SettingsError(
            f"{task.called('observe')} returns {seen} numbers; the networks of {trained.name} "
            f"observe {observes}"
        )
    by_rules = CONTROLLERS[trained.name].driven_by_traffic_rules
    if by_rules and evaluator.start(test, 0, 0).drivers.kind[0] != RULE_BASED:
        raise SettingsError(
            f"{task.called('start')} must leave the ego to the rules of the traffic where "
            f'settings.ego_driver is "rule-based", as for {trained.name}'
        )


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
    where = " in highway-env" if world != "lanewise" else ""
    reporter.stage(f"testing {trained.name}{where}", episodes)
    if world == "lanewise" and trained.exported is None:
        return evaluator.evaluate(config, trained.parameters, seed, episodes, done)
    return stepwise.evaluate(config, _policy(trained), _simulator(world), seed, episodes, done)


def record(
    trained: Trained, world: str, seed: int, episode: int, seconds: int | None = None
) -> Recording:
    """Drive one test episode and keep every frame; for so many seconds, if given."""
    if seconds is not None:
        longer = replace(trained.settings.evaluation, duration=seconds)
        trained = replace(trained, settings=replace(trained.settings, evaluation=longer))
    return stepwise.record(
        evaluation_config(trained), _policy(trained), _simulator(world, 1), seed, episode
    )


def _policy(trained: Trained) -> StepPolicy:
    """Who decides: the file that it comes from, or its networks."""
    return trained.exported.choose if trained.exported else greedy(trained.parameters)


def _simulator(world: str, *size: int) -> Simulator:
    """Who moves the world on; ours so many episodes at a time, a block of them if not given."""
    if world == "lanewise":
        return Lanewise(*size)
    simulator: Simulator = interop.evaluation_in_highway_env().HighwayEnv()
    return simulator
