"""The controllers by name: the stages of their training, their properties, and how each is made.

Imports no JAX: a controller's own module is imported when the controller is made.
"""

from dataclasses import dataclass
from importlib import import_module  # noqa: TID251, names from the registry
from typing import Any


@dataclass(frozen=True)
class Stage:
    """One stage of a controller's training."""

    name: str
    """In metrics, checkpoints and progress."""
    learns: tuple[str, ...]
    """The levels that learn, in the order in which they choose."""
    controller: str
    """The controller that drives while they learn."""
    section: str
    """Section of the settings with the stage's budget."""

    @property
    def level_sections(self) -> tuple[str, ...]:
        """For each level that learns, the section of the settings that says how.

        Where one level learns alone, its settings stand beside the budget.
        """
        if len(self.learns) == 1:
            return (self.section,)
        return tuple(f"{self.section}.{level}" for level in self.learns)


@dataclass(frozen=True)
class ControllerSpec:
    """What is known of a controller before it is made."""

    factory: str
    """Its class, as ``module:class`` in this package."""
    stages: tuple[Stage, ...] = ()
    """Its training, in order; a later stage finds the levels of the earlier ones frozen. Empty for
    a reference driver, which needs no training."""
    has_goals: bool = False
    """Whether a high level sets goals."""
    renewal_configurable: bool = False
    """Whether `GoalSettings` says when its goals are renewed; otherwise the goal critic does."""
    driven_by_traffic_rules: bool = False
    """Whether the world drives the ego, by the rules of the traffic."""
    drives_one_at_a_time: bool = False
    """Whether test episodes are driven one after the other, as each takes much memory."""
    not_exportable: str = ""
    """Why it cannot be exported; empty if it can."""

    @property
    def has_step_1(self) -> bool:
        """Whether its training contains step 1, which another run can take over."""
        return STEP_1 in self.stages


STEP_1 = Stage("step-1", ("high_level",), controller="planned", section="high_level")
STEP_2 = Stage("step-2", ("low_level",), controller="hierarchical", section="low_level")

CONTROLLERS: dict[str, ControllerSpec] = {
    "hierarchical": ControllerSpec(
        "hierarchical:Hierarchical", (STEP_1, STEP_2), has_goals=True, renewal_configurable=True
    ),
    "single-level": ControllerSpec(
        "single_level:SingleLevel",
        (Stage("single-level", ("single_level",), "single-level", section="single_level"),),
    ),
    "planned": ControllerSpec("hierarchical:Planned", (STEP_1,), has_goals=True),
    "h-dqn": ControllerSpec(
        "hierarchical:Hierarchical",
        (Stage("h-dqn", ("high_level", "low_level"), "h-dqn", section="h_dqn"),),
        has_goals=True,
    ),
    "rule-based": ControllerSpec(
        "references:RuleBased",
        driven_by_traffic_rules=True,
        not_exportable="the world itself drives it, by the rules of the traffic",
    ),
    "search": ControllerSpec(
        "references:Search",
        drives_one_at_a_time=True,
        not_exportable="it plans with the world itself and knows how everyone will drive",
    ),
}
STAGES = tuple(dict.fromkeys(stage for spec in CONTROLLERS.values() for stage in spec.stages))
"""Every stage there is."""
TRAINABLE = tuple(name for name, spec in CONTROLLERS.items() if spec.stages)
"""Names of the controllers that are trained."""
REFERENCES = tuple(name for name, spec in CONTROLLERS.items() if not spec.stages)
"""Names of the drivers that need no training, to compare with."""
WITH_STEP_1 = tuple(name for name, spec in CONTROLLERS.items() if spec.has_step_1)
"""Names of the controllers whose step 1 another run can take over."""


def make(name: str, settings: Any, renewal: str, observed: int) -> Any:
    """The controller of a name, made by its class from `lanewise.training.settings.Settings`.

    ``renewal`` says when goals are renewed, see `GoalSettings`; an observation has ``observed``
    numbers.
    """
    module, _, factory = CONTROLLERS[name].factory.partition(":")
    owner = getattr(import_module(f"lanewise.controllers.{module}"), factory)
    return owner.from_settings(settings, name=name, renewal=renewal, observed=observed)
