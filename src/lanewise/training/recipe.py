"""A controller's training and tests as data: who drives in each stage and learns, and for how long.

Which stages there are says `lanewise.controllers.registry`.
"""

from dataclasses import replace
from operator import attrgetter

from lanewise.controllers import registry
from lanewise.controllers.controller import Controller
from lanewise.controllers.registry import CONTROLLERS, Stage
from lanewise.driving.task_functions import PAPER_TASK, TaskFunctions
from lanewise.evaluation.evaluator import BLOCK, EvaluationConfig
from lanewise.training.rollout import StageConfig
from lanewise.training.settings import Settings

HELD = "critic"
"""When goals are renewed: only once the critic has ended them."""


def stage_config(settings: Settings, stage: Stage, task: TaskFunctions = PAPER_TASK) -> StageConfig:
    """The static part of a stage.

    `GoalSettings.training_renewal` speaks of step 2; elsewhere goals are held by the critic.
    """
    spec = CONTROLLERS[stage.controller]
    renewal = settings.goals.training_renewal if spec.renewal_configurable else HELD
    return StageConfig(
        scenario=settings.scenario,
        driving=settings.driving,
        controller=_controller(settings, stage.controller, renewal, task),
        budget=attrgetter(stage.section)(settings),
        learning=tuple(
            (level, attrgetter(section)(settings))
            for level, section in zip(stage.learns, stage.level_sections, strict=True)
        ),
        task=task,
    )


def validation_config(
    settings: Settings, stage: Stage, task: TaskFunctions = PAPER_TASK
) -> EvaluationConfig:
    """Greedy episodes on validation starts, by which a stage's weights are chosen."""
    return replace(evaluation_config(settings, stage.controller, task=task), split="validation")


def evaluation_config(
    settings: Settings, name: str, renewal: str | None = None, task: TaskFunctions = PAPER_TASK
) -> EvaluationConfig:
    """Greedy test episodes of a controller.

    `GoalSettings.test_renewal` speaks of the hierarchical controller; the others keep their goals
    as long as in their training.
    """
    spec = CONTROLLERS[name]
    renewal = renewal or (settings.goals.test_renewal if spec.renewal_configurable else HELD)
    scenario = settings.scenario
    if spec.driven_by_traffic_rules:
        scenario = replace(scenario, ego_driver="rule-based")
    return EvaluationConfig(
        scenario=scenario,
        driving=settings.driving,
        controller=_controller(settings, name, renewal, task),
        duration=settings.driving.decisions_in(settings.evaluation.duration),
        at_once=1 if spec.drives_one_at_a_time else BLOCK,
        task=task,
    )


def _controller(settings: Settings, name: str, renewal: str, task: TaskFunctions) -> Controller:
    observed = task.validate(settings.scenario, settings.driving)
    made: Controller = registry.make(name, settings, renewal, observed)
    return made
