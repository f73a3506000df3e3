"""The paper's figures stand beside a test or training only where it is the paper's."""

import pytest

from lanewise import config
from lanewise.config.settings import PRESETS
from lanewise.experiments import published


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"evaluation.duration": 40}, "evaluation.duration is 40, not 25"),
        ({"scenario.trap_speed": 10.9}, "scenario.trap_speed is 10.9, not 10.0"),
        ({"driving.reward.speed_weight": 2.0}, "driving.reward.speed_weight is 2.0, not 1.5"),
    ],
)
def test_each_way_in_which_a_test_is_no_longer_the_papers(changes, said):
    assert published.unlike_test(config.compose(flags=changes)) == said


@pytest.mark.parametrize(
    "changes",
    [
        {"driving.observation.scaling": "highway-env", "driving.actions.acceleration": 2.0},
        {"goals.time_limit": 1000.0, "low_level.tracking_weight": 0.0, "single_level.hold": 5},
        {"evaluation.validation_episodes": 100},
    ],
    ids=str,
)
def test_another_controller_takes_the_same_test(changes):
    """What a controller is and how it was made: another arm, not another test."""
    assert published.unlike_test(config.compose(flags=changes)) == ""
    assert published.unlike_training(config.compose(flags=changes)) == ""


@pytest.mark.parametrize("preset", PRESETS)
def test_every_preset_is_tested_as_the_paper_tests(preset):
    """Over ranges of starts only training varies."""
    assert published.unlike_test(config.compose(preset)) == ""
    assert (published.unlike_training(config.compose(preset)) == "") == (preset != "ranges")


def test_a_training_may_have_either_speed_of_the_trap_and_tests_of_any_length():
    for changes, said in (
        ({"scenario.trap_speed": 10.9, "evaluation.duration": 40}, ""),
        ({"scenario.trap_speed": 9.0}, "scenario.trap_speed is 9.0, not 10.0"),
        (
            {"driving.reward.accident_penalty": 1.0},
            "driving.reward.accident_penalty is 1.0, not 10.0",
        ),
    ):
        assert published.unlike_training(config.compose(flags=changes)) == said
