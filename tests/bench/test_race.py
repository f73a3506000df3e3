"""The race searches settings that exist, around the defaults."""

import importlib.util
from pathlib import Path

import pytest

from lanewise import config

FILE = Path(__file__).resolve().parents[2] / "benchmarks" / "race.py"


@pytest.fixture(scope="module")
def race():
    spec = importlib.util.spec_from_file_location("race", FILE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("controller", ["single-level", "h-dqn"])
def test_every_setting_of_the_race_is_one(race, controller):
    defaults = config.flatten(config.compose())
    for name, values in race.SPACES[controller].items():
        assert defaults[name] in values, f"{name}: the default is not among what is tried"
        for value in values:
            config.compose(flags={name: value})


def test_both_get_as_many_trainings_as_the_hierarchical_controller_had(race):
    for controller in race.SPACES:
        tried = race.settings_of(controller)
        assert tried == race.settings_of(controller)
        assert len({tuple(sorted(each.items())) for each in tried}) == len(tried) == 25
    assert len(tried) + race.BEST * len(race.MORE_SEEDS) == 37
