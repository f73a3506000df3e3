"""Recipes as data: which stages make a controller, who learns in each, what it hands on."""

from dataclasses import dataclass, replace
from typing import Protocol

from lanewise.controllers.controller import Controller
from lanewise.controllers.hierarchical import Hierarchical
from lanewise.controllers.planned import Planned
from lanewise.controllers.rule_based import RuleBased
from lanewise.controllers.search import Search
from lanewise.controllers.settings import GoalSettings, PlannerSettings, SearchSettings
from lanewise.controllers.single_level import SingleLevel
from lanewise.driving.parts import OURS, Parts
from lanewise.driving.settings import DrivingSettings
from lanewise.evaluation.evaluator import BLOCK, EvaluationConfig
from lanewise.evaluation.settings import EvaluationSettings
from lanewise.scenario.settings import TrapSettings
from lanewise.training.rollout import Course
from lanewise.training.settings import (
    BudgetSettings,
    HDQNSettings,
    LevelSettings,
    SingleLevelSettings,
    StageSettings,
)


class RecipeSettings(Protocol):
    """The settings a recipe reads; `lanewise.settings.Settings` is the one there is."""

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


@dataclass(frozen=True)
class Stage:
    """One stage of a recipe."""

    name: str
    """In metrics, checkpoints and progress."""
    learns: tuple[str, ...]
    """The levels that learn, in the order in which they choose."""
    controller: str
    """The controller that drives while they learn."""


STEP_1 = Stage("step-1", learns=("high_level",), controller="planned")
STEP_2 = Stage("step-2", learns=("low_level",), controller="hierarchical")

RECIPES = {
    "hierarchical": (STEP_1, STEP_2),
    "planned": (STEP_1,),
    "single-level": (Stage("single-level", learns=("single_level",), controller="single-level"),),
    "h-dqn": (Stage("h-dqn", learns=("high_level", "low_level"), controller="h-dqn"),),
}
"""The stages of each trainable controller, in order; a later one finds the earlier ones' levels
frozen."""

HELD = "critic"
"""When goals are renewed: only once the critic has ended them."""


def controller(
    settings: RecipeSettings, name: str, renewal: str, parts: Parts = OURS
) -> Controller:
    """The controller of a name, with goals renewed as ``renewal`` says."""
    driving, goals = settings.driving, settings.goals
    observed = parts.try_out(settings.scenario, driving)
    match name:
        case "planned":
            return Planned(driving, goals, settings.planner, renewal, observed=observed)
        case "hierarchical" | "h-dqn":
            return Hierarchical(driving, goals, renewal, name, observed)
        case "single-level":
            return SingleLevel(settings.single_level.hold, observed=observed)
        case "rule-based":
            return RuleBased()
        case "search":
            return Search(driving, settings.search, test_duration(settings))
    raise ValueError(f"no controller is called {name}")


def budget(settings: RecipeSettings, stage: Stage) -> BudgetSettings:
    """How long a stage drives."""
    alone: StageSettings = getattr(settings, stage.learns[0])
    return settings.h_dqn if stage.name == "h-dqn" else alone


def learning(settings: RecipeSettings, stage: Stage) -> tuple[tuple[str, LevelSettings], ...]:
    """The levels of a stage that learn, and how."""
    owner = settings.h_dqn if stage.name == "h-dqn" else settings
    return tuple((name, getattr(owner, name)) for name in stage.learns)


def course(settings: RecipeSettings, stage: Stage, parts: Parts = OURS) -> Course:
    """The static part of a stage.

    `GoalSettings.training_renewal` speaks of step 2; elsewhere goals are held by the critic.
    """
    renewal = settings.goals.training_renewal if stage == STEP_2 else HELD
    return Course(
        scenario=settings.scenario,
        driving=settings.driving,
        controller=controller(settings, stage.controller, renewal, parts),
        budget=budget(settings, stage),
        learning=learning(settings, stage),
        parts=parts,
    )


def validation_course(
    settings: RecipeSettings, stage: Stage, parts: Parts = OURS
) -> EvaluationConfig:
    """Greedy episodes on validation starts, by which a stage's weights are chosen."""
    return replace(test_course(settings, stage.controller, parts=parts), split="validation")


def test_course(
    settings: RecipeSettings, name: str, renewal: str | None = None, parts: Parts = OURS
) -> EvaluationConfig:
    """Greedy test episodes of a controller.

    `GoalSettings.test_renewal` speaks of the hierarchical controller; the others keep their goals
    as long as in their training.
    """
    renewal = renewal or (settings.goals.test_renewal if name == "hierarchical" else HELD)
    scenario = settings.scenario
    if name == "rule-based":
        scenario = replace(scenario, ego_driver="rule-based")
    return EvaluationConfig(
        scenario=scenario,
        driving=settings.driving,
        controller=controller(settings, name, renewal, parts),
        duration=test_duration(settings),
        at_once=1 if name == "search" else BLOCK,
        parts=parts,
    )


def test_duration(settings: RecipeSettings) -> int:
    """Length of a test in decisions."""
    return settings.driving.decisions_in(settings.evaluation.duration)
