"""Recipes as data: which stages make a controller, who learns in each, what it hands on."""

from dataclasses import dataclass, replace
from typing import Protocol

from lanewise.controllers.controller import Controller
from lanewise.controllers.hierarchical import Hierarchical
from lanewise.controllers.planned import Planned
from lanewise.controllers.settings import GoalSettings, PlannerSettings
from lanewise.controllers.single_level import SingleLevel
from lanewise.driving.settings import DrivingSettings
from lanewise.evaluation.drive import TestCourse
from lanewise.evaluation.settings import EvaluationSettings
from lanewise.scenario.settings import TrapSettings
from lanewise.training.rollout import Course
from lanewise.training.settings import StageSettings


class RecipeSettings(Protocol):
    """The settings a recipe reads; `lanewise.config.Settings` is the one there is."""

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
    def evaluation(self) -> EvaluationSettings:
        """How controllers are tested."""

    @property
    def single_level(self) -> StageSettings:
        """Training of the single-level controller."""

    @property
    def high_level(self) -> StageSettings:
        """Step 1."""

    @property
    def low_level(self) -> StageSettings:
        """Step 2."""


@dataclass(frozen=True)
class Stage:
    """One stage of a recipe."""

    name: str
    """In metrics, checkpoints and progress."""
    level: str
    """The level that learns; also the name of its `StageSettings`."""
    controller: str
    """The controller that drives while it learns."""


RECIPES = {
    "hierarchical": (
        Stage("step-1", level="high_level", controller="planned"),
        Stage("step-2", level="low_level", controller="hierarchical"),
    ),
    "single-level": (Stage("single-level", level="single_level", controller="single-level"),),
}
"""The stages of each trainable controller, in order; a later one finds the earlier ones' levels
frozen."""


def controller(settings: RecipeSettings, name: str, renewal: str) -> Controller:
    """The controller of a name, with goals renewed as ``renewal`` says."""
    if name == "planned":
        return Planned(settings.driving, settings.goals, settings.planner, renewal)
    if name == "hierarchical":
        return Hierarchical(settings.driving, settings.goals, renewal)
    return SingleLevel()


def course(settings: RecipeSettings, stage: Stage) -> Course:
    """The static part of a stage.

    In step 1 goals are always held by the critic; `GoalSettings.training_renewal` speaks of step 2.
    """
    renewal = settings.goals.training_renewal if stage.controller == "hierarchical" else "critic"
    return Course(
        scenario=settings.scenario,
        driving=settings.driving,
        controller=controller(settings, stage.controller, renewal),
        stage=getattr(settings, stage.level),
    )


def validation_course(settings: RecipeSettings, stage: Stage) -> TestCourse:
    """Greedy episodes on validation starts, by which a stage's weights are chosen."""
    return replace(test_course(settings, stage.controller), split="validation")


def test_course(settings: RecipeSettings, name: str, renewal: str | None = None) -> TestCourse:
    """Greedy test episodes of a controller; goals renewed as its test setting says."""
    return TestCourse(
        scenario=settings.scenario,
        driving=settings.driving,
        controller=controller(settings, name, renewal or settings.goals.test_renewal),
        duration=settings.evaluation.duration * settings.driving.decision_frequency,
    )
