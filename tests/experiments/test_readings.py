"""The table of readings is true of whatever the arms of an experiment were run with."""

import json
import re

import pytest

from lanewise import config
from lanewise.controllers.registry import CONTROLLERS, TRAINABLE
from lanewise.experiments import experiment, readings
from lanewise.experiments.readings import ArmSettings

QUOTED = re.compile(r"`(\*?[a-z_.]+) = ([^`]*)`")
FLAT_ALONE = """
seeds = 1
episodes = 1
highway_env_episodes = 0
[arms.a]
title = "flat | one"
controller = "single-level"
[arms.a.settings]
"scenario.ego_speed" = 12.5
"single_level.keep" = "last"
[arms.b]
title = "slow"
controller = "single-level"
[arms.b.settings]
"single_level.learner.learning_rate" = 0.01
[arms.c]
controller = "rule-based"
"""


def arms_of(found):
    return [
        ArmSettings(
            *(arm.title, arm.controller, config.flatten(found.settings(arm, "trap-10", {}))),
            takes_over=bool(arm.high_level),
        )
        for arm in found.arms
    ]


def here(arms):
    """The third cell of each row by its number; that of Adam's row has none."""
    lines = readings.table(arms).splitlines()[2:]
    return {(row := re.split(r"(?<!\\)\|", line))[1].strip(): row[3].strip() for line in lines}


@pytest.mark.parametrize("name", experiment.BUILT_IN)
def test_every_value_shown_is_one_that_an_arm_has(name):
    arms = arms_of(experiment.load(name))
    shown = QUOTED.findall(readings.table(arms))
    assert len(shown) > 40
    for setting, value in shown:
        had = {
            json.dumps(arm.settings[each])
            for arm in arms
            for each in arm.names(setting)
            if not setting.startswith("h_dqn") or arm.controller == "h-dqn"
        }
        assert value in had, setting
        assert not setting.startswith("*") or had == {value}, setting


def test_at_the_papers_size_the_rows_say_what_was_used():
    """Rows Adam, 27 and 28 spoke of the preset quick alone."""
    rows = here(arms_of(experiment.load("paper")))
    assert "`*.learner.learning_rate_decay = 0` updates, and stays constant with 0" in rows[""]
    assert rows["27"].startswith(
        '`single_level.keep = "last"`, `high_level.keep = "best-training"`'
    )
    assert '`low_level.keep = "last"`' in rows["27"]
    assert "`high_level.episodes = 1000`, `low_level.episodes = 2000`" in rows["28"]
    assert "`*.decisions = 0`" in rows["28"]
    assert not any("twin" in cell for cell in rows.values())
    # Arms that differ from the others are named.
    assert '`"critic"` in *hierarchical, goals held in training*)' in rows["22a"]


def test_an_experiment_of_ones_own():
    arms = arms_of(experiment.parse("mine", FLAT_ALONE))
    rows, table = here(arms), readings.table(arms)
    assert rows["6"] == r"`scenario.ego_speed = 10.0` (`12.5` in *flat \| one*)"
    # The reason is that of the default, which not all of them have.
    assert "| of the default: fitted to the test table |" in table
    assert rows["27"].startswith('`single_level.keep = "last"` (`"best-validation"` in *slow*)')
    assert "`single_level.learner.learning_rate = 0.001` (`0.01` in *slow*)" in rows[""]
    # Nobody has goals, nor steps 1 and 2.
    for number in ("11", "12", "13", "14", "21", "22a", "22b", "22c", "23", "26"):
        assert rows[number] == readings.UNUSED, number
    assert len({len(re.split(r"(?<!\\)\|", line)) for line in table.splitlines()}) == 1


def test_whatever_learns_is_shown():
    arms = readings.by_default()
    assert [arm.controller for arm in arms] == list(TRAINABLE)
    for arm in arms:
        levels = {level for stage in CONTROLLERS[arm.controller].stages for level in stage.learns}
        shown = {name.split(".")[-3] for name in arm.names("*.learner.discount")}
        assert shown == levels
