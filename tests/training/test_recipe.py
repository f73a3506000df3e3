"""Recipes: which controller drives in a stage and in tests, and when its goals are renewed."""

import pytest

from lanewise import config
from lanewise.training import recipe

RENEWED = {"goals.training_renewal": "timestep", "goals.test_renewal": "decision"}


@pytest.fixture
def settings():
    return config.compose(flags=RENEWED)


@pytest.mark.parametrize(
    ("name", "renewals"),
    [("planned", ["critic"]), ("hierarchical", ["critic", "timestep"]), ("h-dqn", ["critic"])],
)
def test_where_a_high_level_learns_the_critic_holds_its_goals(settings, name, renewals):
    courses = [recipe.stage_config(settings, stage) for stage in recipe.RECIPES[name]]
    assert [course.controller.renewal for course in courses] == renewals


@pytest.mark.parametrize(
    ("name", "renewal"), [("planned", "critic"), ("hierarchical", "decision"), ("h-dqn", "critic")]
)
def test_goals_are_renewed_in_tests_as_in_the_last_training_unless_the_setting_speaks_of_them(
    settings, name, renewal
):
    stage = recipe.RECIPES[name][-1]
    for course in (
        recipe.evaluation_config(settings, name),
        recipe.validation_config(settings, stage),
    ):
        assert course.controller.renewal == renewal
    asked = recipe.evaluation_config(settings, name, "timestep")
    assert asked.controller.renewal == "timestep"


def test_weights_are_chosen_on_validation_starts_alone(settings):
    for stages in recipe.RECIPES.values():
        for stage in stages:
            assert recipe.validation_config(settings, stage).split == "validation"
            assert recipe.evaluation_config(settings, stage.controller).split == "test"
