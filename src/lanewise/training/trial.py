"""A training with the user's own parts tried in full, before anything is made of it.

Traced and not run, which costs nothing: JAX keeps what it has traced, and the training finds it.
"""

from functools import partial

import jax

from lanewise.controllers.controller import Parameters
from lanewise.driving.parts import Parts, named
from lanewise.errors import SettingsError
from lanewise.evaluation import evaluator
from lanewise.scenario.trap import SPLITS
from lanewise.training import recipe, stage
from lanewise.training.recipe import RecipeSettings


def trace(settings: RecipeSettings, controller: str, parts: Parts) -> int:
    """Trace the programs of all stages of a controller.

    Returns:
        Length of what the controller sees.

    Raises:
        SettingsError: a function fails, or returns something else than it must.
    """
    observed = parts.try_out(settings.scenario, settings.driving)
    if not parts.names():
        return observed
    for split in SPLITS:
        length = parts.try_out(settings.scenario, settings.driving, split)
        if length != observed:
            raise SettingsError(
                f"{parts.called('observe')} returns {observed} numbers in training and {length} in "
                f"{split}; it must return as many"
            )
    frozen: Parameters = {}
    with named(f"{'; '.join(parts.names())} (in a training)"):
        for each in recipe.RECIPES[controller]:
            frozen = frozen | _learnt(settings, each, parts, frozen)
    return observed


def _learnt(
    settings: RecipeSettings, each: recipe.Stage, parts: Parts, frozen: Parameters
) -> Parameters:
    """What a stage would hand on, as shapes, once its programs are traced."""
    course = recipe.course(settings, each, parts)
    validation = recipe.validation_course(settings, each, parts)
    key = jax.eval_shape(partial(jax.random.key, 0))
    state = jax.eval_shape(partial(stage.begin, course), frozen, key)
    learnt = stage.online(state.learners)
    jax.eval_shape(partial(stage.advance, course), frozen, state)
    worlds = jax.eval_shape(partial(evaluator.start_block, validation, 0, 0))
    jax.eval_shape(partial(evaluator.drive_block, validation), frozen | learnt, worlds)
    return learnt
