"""Other people's learners on the trap: each beats chance within its few steps.

Needs PyTorch and the extra ``examples``: ``python -m pytest --dist load examples``.
"""

import importlib.util
import warnings
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from stable_baselines3.common.env_checker import check_env

from lanewise.envs.registration import ENVIRONMENTS

HERE = Path(__file__).parent
LEARNERS = ("sb3_dqn", "sb3_ppo", "cleanrl_style_dqn", "tianshou_double_dqn", "jax_loop")
ESCAPING = ("sb3_dqn", "tianshou_double_dqn")
"""Those that choose goals: they get out."""


def example(name):
    spec = importlib.util.spec_from_file_location(name, HERE / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", LEARNERS)
def test_it_beats_chance(name, capsys):
    with warnings.catch_warnings():
        warnings.filterwarnings("error", category=UserWarning)
        learnt, random = (tested.summary for tested in example(name).main())
    lowest, _ = learnt.intervals["accumulated_reward"]
    _, highest = random.intervals["accumulated_reward"]
    assert lowest > highest
    assert learnt.intervals["accident_rate"][1] < random.intervals["accident_rate"][0]
    if name in ESCAPING:
        assert learnt.values["success_rate"] > 0.5
        assert random.values["success_rate"] < 0.1
    assert "random, lanewise" in capsys.readouterr().out


def test_highway_env_quick_start():
    module = example("highway_env_quick_start")
    there = module.drive("lanewise/TrapHighwayEnv-v0", 40, 1)
    here = module.drive("lanewise/Trap-v0", 40, 1)
    assert np.allclose(there, here, atol=1e-5)
    assert len(set(here)) > 10
    learnt, random = (tested.summary for tested in module.main(steps=20))
    assert learnt.world == random.world == "highway-env"
    assert learnt.values["success_rate"] > 0.5 > random.values["success_rate"]


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_stable_baselines3_has_nothing_to_say(name):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gymnasium.make(name))


def test_every_example_is_tested_and_described():
    files = {file.stem for file in HERE.glob("*.py")} - {"record", Path(__file__).stem}
    # `hierarchical_dqn` needs no other library: tests/training/test_first_updates.py.
    assert files == {*LEARNERS, "highway_env_quick_start", "hierarchical_dqn"}
    page = (HERE / "README.md").read_text()
    assert all(f"{name}.py" in page for name in files)
    assert set(LEARNERS) == set(example("record").EXAMPLES)
