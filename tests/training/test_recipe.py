"""Recipes: which controller drives in a stage and in tests, and when its goals are renewed."""

import pytest

from lanewise import config
from lanewise.controllers.registry import CONTROLLERS, STAGES
from lanewise.training import recipe

RENEWED = {"goals.training_renewal": "timestep", "goals.test_renewal": "decision"}


@pytest.fixture
def settings():
    return config.compose(flags=RENEWED)


@pytest.mark.parametrize(
    ("name", "in_stages", "in_tests"),
    [
        ("planned", ["critic"], "critic"),
        ("hierarchical", ["critic", "timestep"], "decision"),
        ("h-dqn", ["critic"], "critic"),
    ],
)
def test_where_a_high_level_learns_the_critic_holds_its_goals(settings, name, in_stages, in_tests):
    """And tests do as the last training, unless the setting speaks of them."""
    stages = CONTROLLERS[name].stages
    courses = [recipe.stage_config(settings, stage) for stage in stages]
    courses.append(recipe.evaluation_config(settings, name))
    courses.append(recipe.validation_config(settings, stages[-1]))
    courses.append(recipe.evaluation_config(settings, name, "timestep"))
    renewals = [course.controller.renewal for course in courses]
    assert renewals == [*in_stages, in_tests, in_tests, "timestep"]


def test_weights_are_chosen_on_validation_starts_alone(settings):
    for stage in STAGES:
        assert recipe.validation_config(settings, stage).split == "validation"
        assert recipe.evaluation_config(settings, stage.controller).split == "test"
