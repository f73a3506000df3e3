"""The plan of a training: all that follows from its settings, built once and passed down."""

from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import jax

from lanewise.controllers.controller import Parameters
from lanewise.controllers.registry import CONTROLLERS
from lanewise.driving.task_functions import PAPER_TASK, TaskFunctions, named
from lanewise.errors import SettingsError
from lanewise.evaluation import evaluator
from lanewise.learning import network
from lanewise.scenario.trap import SPLITS
from lanewise.system import pinned
from lanewise.training import recipe, selection, stage
from lanewise.training.settings import Settings
from lanewise.training.trainer import StagePlan


@dataclass(frozen=True)
class TrainingPlan:
    """The stages of a training, and the shapes of what they store."""

    settings: Settings
    controller: str
    """What is trained: a name in `lanewise.controllers.registry.TRAINABLE`."""
    task: TaskFunctions
    """The user's own functions."""
    stages: tuple[StagePlan, ...]
    """In order; a later one finds the levels of the earlier ones frozen."""

    @classmethod
    def build(
        cls, settings: Settings, controller: str, task: TaskFunctions = PAPER_TASK
    ) -> "TrainingPlan":
        """The plan of a controller's training; raises as `trace`."""
        stages = tuple(
            StagePlan(
                name=each.name,
                config=recipe.stage_config(settings, each, task),
                validation=recipe.validation_config(settings, each, task),
                tests=settings.evaluation,
            )
            for each in CONTROLLERS[controller].stages
        )
        return cls(settings, controller, task, stages)

    @cached_property
    def weights(self) -> dict[str, Parameters]:
        """Shapes of the networks that learn, by stage."""
        with pinned.switches():
            return {each.name: jax.eval_shape(partial(_networks, each)) for each in self.stages}

    @property
    def parameters(self) -> Parameters:
        """Shapes of the finished controller's networks."""
        return self.frozen(len(self.stages))

    def frozen(self, index: int) -> Parameters:
        """Shapes of the networks that are frozen in a stage: those of all earlier ones."""
        found: Parameters = {}
        for each in self.stages[:index]:
            found = found | self.weights[each.name]
        return found

    @pinned.switches()
    def progress(self, index: int) -> dict[str, Any]:
        """Shapes of `StageProgress.arrays` in a stage."""
        plan = self.stages[index]
        state = jax.eval_shape(
            lambda frozen: stage.begin(plan.config, frozen, pinned.key(0)), self.frozen(index)
        )
        weights = self.weights[plan.name]
        window = selection.no_window(plan.config.budget.keep, weights)
        return {"state": state, "best": weights, "window": window}

    def trace(self) -> int:
        """Try the user's own functions in full: the length of an observation.

        All programs of the training are traced, none runs; JAX keeps what it has traced.

        Raises:
            SettingsError: a function fails, or returns something else than it must.
        """
        scenario, driving = self.settings.scenario, self.settings.driving
        observed = self.task.validate(scenario, driving)
        if not self.task.names():
            return observed
        for split in SPLITS:
            length = self.task.validate(scenario, driving, split)
            if length != observed:
                raise SettingsError(
                    f"{self.task.called('observe')} returns {observed} numbers in training and "
                    f"{length} in {split}; it must return as many"
                )
        with named(f"{'; '.join(self.task.names())} (in a training)"):
            for index, each in enumerate(self.stages):
                state, frozen = self.progress(index)["state"], self.frozen(index)
                jax.eval_shape(partial(stage.advance, each.config), frozen, state)
                worlds = jax.eval_shape(partial(evaluator.start_block, each.validation, 0, 0))
                levels = frozen | self.weights[each.name]
                test = evaluator.of_any_start(each.validation)
                jax.eval_shape(partial(evaluator.drive_block, test), levels, worlds)
        return observed


def _networks(plan: StagePlan) -> Parameters:
    """Fresh networks of the levels that learn in a stage."""
    found: Parameters = {}
    for name, settings in plan.config.learning:
        level = plan.config.level(name)
        learner, sizes = settings.learner, (level.feature_count, level.choice_count)
        found[name] = network.init(
            *(pinned.key(0), sizes[0], learner.hidden, sizes[1], learner.layer_normalisation)
        )
    return found
