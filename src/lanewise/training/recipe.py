"""A controller's training and tests as data: who drives in each stage and learns, and for how long.

Which stages there are says `lanewise.controllers.registry`.
"""

from dataclasses import replace
from operator import attrgetter
from typing import Protocol

from lanewise.controllers import registry
from lanewise.controllers.controller import Controller
from lanewise.controllers.registry import CONTROLLERS, Stage
from lanewise.controllers.settings import GoalSettings, PlannerSettings, SearchSettings
from lanewise.driving.settings import DrivingSettings
from lanewise.driving.task_functions import PAPER_TASK, TaskFunctions
from lanewise.evaluation.evaluator import BLOCK, EvaluationConfig
from lanewise.evaluation.settings import EvaluationSettings
from lanewise.scenario.settings import TrapSettings
from lanewise.training.rollout import StageConfig
from lanewise.training.settings import (
    BudgetSettings,
    HDQNSettings,
    LevelSettings,
    SingleLevelSettings,
    StageSettings,
)


class RecipeSettings(Protocol):
    """The settings a recipe reads; `lanewise.config.settings.Settings` is the one there is."""

    @property
    def scenario(self) -> TrapSettings:
        """Who stands where at the start."""

    @property
    def driving(self) -> DrivingSettings:
        """The decision process."""

    @property
    def goals(self) -> GoalSettings:
        """What the high level may ask for."""

    @property
    def planner(self) -> PlannerSettings:
        """The planner of step 1."""

    @property
    def search(self) -> SearchSettings:
        """The search, a reference."""

    @property
    def evaluation(self) -> EvaluationSettings:
        """How controllers are tested."""

    @property
    def single_level(self) -> SingleLevelSettings:
        """Training of the single-level controller."""

    @property
    def high_level(self) -> StageSettings:
        """Step 1."""

    @property
    def low_level(self) -> StageSettings:
        """Step 2."""

    @property
    def h_dqn(self) -> HDQNSettings:
        """Both levels together."""


RECIPES = {name: spec.stages for name, spec in CONTROLLERS.items() if spec.stages}
"""The stages of each controller that is trained, in order."""

HELD = "critic"
"""When goals are renewed: only once the critic has ended them."""


def controller(
    settings: RecipeSettings, name: str, renewal: str, task: TaskFunctions = PAPER_TASK
) -> Controller:
    """The controller of a name, with goals renewed as ``renewal`` says."""
    observed = task.validate(settings.scenario, settings.driving)
    made: Controller = registry.make(name, settings, renewal, observed)
    return made


def budget(settings: RecipeSettings, stage: Stage) -> BudgetSettings:
    """How long a stage drives."""
    found: BudgetSettings = attrgetter(stage.section)(settings)
    return found


def learning(settings: RecipeSettings, stage: Stage) -> tuple[tuple[str, LevelSettings], ...]:
    """The levels of a stage that learn, and how."""
    sections = zip(stage.learns, stage.level_sections, strict=True)
    return tuple((name, attrgetter(section)(settings)) for name, section in sections)


def stage_config(
    settings: RecipeSettings, stage: Stage, task: TaskFunctions = PAPER_TASK
) -> StageConfig:
    """The static part of a stage.

    `GoalSettings.training_renewal` speaks of step 2; elsewhere goals are held by the critic.
    """
    spec = CONTROLLERS[stage.controller]
    renewal = settings.goals.training_renewal if spec.renewal_configurable else HELD
    return StageConfig(
        scenario=settings.scenario,
        driving=settings.driving,
        controller=controller(settings, stage.controller, renewal, task),
        budget=budget(settings, stage),
        learning=learning(settings, stage),
        task=task,
    )


def validation_config(
    settings: RecipeSettings, stage: Stage, task: TaskFunctions = PAPER_TASK
) -> EvaluationConfig:
    """Greedy episodes on validation starts, by which a stage's weights are chosen."""
    return replace(evaluation_config(settings, stage.controller, task=task), split="validation")


def evaluation_config(
    settings: RecipeSettings,
    name: str,
    renewal: str | None = None,
    task: TaskFunctions = PAPER_TASK,
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
        controller=controller(settings, name, renewal, task),
        duration=test_duration(settings),
        at_once=1 if spec.drives_one_at_a_time else BLOCK,
        task=task,
    )


def test_duration(settings: RecipeSettings) -> int:
    """Length of a test in decisions."""
    return settings.driving.decisions_in(settings.evaluation.duration)
