"""The paper's figures stand beside a test or training only where it is the paper's."""

import pytest

from lanewise import config
from lanewise.config.settings import PRESETS
from lanewise.experiments.published import unlike_test, unlike_training

OF_THE_CONTROLLER = (
    {"driving.observation.scaling": "highway-env", "driving.actions.acceleration": 2.0},
    {"goals.time_limit": 1000.0, "low_level.tracking_weight": 0.0, "single_level.hold": 5},
    {"evaluation.validation_episodes": 100},
)
"""What a controller is and how it was made: another arm, not another test."""


@pytest.mark.parametrize(
    ("unlike", "changes", "said"),
    [
        (unlike_test, {"evaluation.duration": 40}, "evaluation.duration is 40, not 25"),
        (unlike_test, {"scenario.trap_speed": 10.9}, "scenario.trap_speed is 10.9, not 10.0"),
        (
            *(unlike_test, {"driving.reward.speed_weight": 2.0}),
            "driving.reward.speed_weight is 2.0, not 1.5",
        ),
        # A training may have either speed of the trap, and tests of any length.
        (unlike_training, {"scenario.trap_speed": 10.9, "evaluation.duration": 40}, ""),
        (unlike_training, {"scenario.trap_speed": 9.0}, "scenario.trap_speed is 9.0, not 10.0"),
        (
            *(unlike_training, {"driving.reward.accident_penalty": 1.0}),
            "driving.reward.accident_penalty is 1.0, not 10.0",
        ),
        *((unlike_test, changes, "") for changes in OF_THE_CONTROLLER),
        *((unlike_training, changes, "") for changes in OF_THE_CONTROLLER),
    ],
)
def test_the_setting_that_makes_it_no_longer_the_papers_is_named(unlike, changes, said):
    assert unlike(config.compose(flags=changes)) == said


@pytest.mark.parametrize("preset", PRESETS)
def test_every_preset_but_the_driver_is_tested_as_the_paper_tests(preset):
    for unlike in (unlike_test, unlike_training):
        assert (unlike(config.compose(preset)) == "") == (preset != "driver")
    assert unlike_test(config.compose(flags={"driving.observation.noise": 0.1})) != ""
