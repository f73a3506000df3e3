"""Experiments as data: what the built-in ones say, and what is refused."""

from pathlib import Path

import pytest

from lanewise import config
from lanewise.errors import LanewiseError, SettingsError
from lanewise.experiments import experiment

BUILT_IN = [experiment.load(name) for name in experiment.BUILT_IN]
BESIDE = [
    experiment.load_file(file)
    for file in sorted(Path(__file__).resolve().parents[2].glob("benchmarks/*.toml"))
]
HEAD = 'preset = "quick"\nseeds = 2\nepisodes = 3\nhighway_env_episodes = 0\n'
ARM = '[arms.a]\ncontroller = "single-level"\n'
LENT = '[arms.a]\ncontroller = "hierarchical"\nhigh_level = "b"\n'
LENDER = '[arms.b]\ncontroller = "planned"\n'


@pytest.mark.parametrize("found", [*BUILT_IN, *BESIDE], ids=lambda found: found.name)
def test_every_experiment_can_be_run(found):
    assert len({arm.title for arm in found.arms}) == len(found.arms)
    usual = config.flatten(config.compose(found.preset))
    for arm in found.arms:
        flat = config.flatten(found.settings(arm, "trap-10", {}))
        for setting, value in arm.changes.items():
            assert flat[setting] == value != usual[setting]


@pytest.mark.parametrize("name", ["standard", "paper"])
def test_the_large_ones_hold_every_arm_of_the_paper(name):
    arms = {arm.name: arm for arm in experiment.load(name).arms}
    assert {arm.controller for arm in arms.values()} >= {
        *("planned", "hierarchical", "h-dqn", "single-level", "rule-based")
    }
    schedules = []
    for arm in ("single-level", "single-level-from-1", "single-level-over-5000"):
        found = experiment.load(name).settings(arms[arm], "trap-10", {}).single_level
        # At the reduced budget a step of the paper is one in each of the worlds.
        worlds = found.worlds if name == "standard" else 1
        schedules.append((found.exploration.start, found.exploration.steps / worlds))
    assert schedules == [(0.5, 1000), (1.0, 1000), (0.5, 5000)]


def test_the_papers_size():
    """2000 episodes, 1000 for step 1, at most 250 decisions each, for every arm that learns."""
    found = experiment.load("paper")
    for arm in found.arms:
        settings = found.settings(arm, "trap-10", {})
        budgets = {
            "single-level": [(settings.single_level, 2000)],
            "planned": [(settings.high_level, 1000)],
            "hierarchical": [(settings.low_level, 2000)],
            "h-dqn": [(settings.h_dqn, 2000)],
        }.get(arm.controller, [])
        for budget, episodes in budgets:
            assert (budget.episodes, budget.decisions, budget.duration) == (episodes, 0, 250)


@pytest.mark.parametrize(
    ("text", "hint"),
    [
        ("[[", "not valid TOML"),
        (HEAD, "needs at least one [arms.NAME]"),
        (HEAD.replace("seeds = 2", "seed = 2") + ARM, 'has no "seed"; did you mean seeds?'),
        (HEAD + ARM + 'high_level = "b"\n', 'arm a: high_level "b" is no arm'),
        (HEAD + LENT + LENDER + "seeds = 1\n", "arm a: has more seeds than b"),
        (
            HEAD + LENT + LENDER + '[arms.b.settings]\n"goals.time_limit" = 5.0\n',
            "arm a: b was made with other goals or driving settings",
        ),
        (HEAD + ARM + '[arms.a.settings]\n"goals.speed_stp" = 1.0\n', "mean goals.speed_step"),
        (HEAD + ARM.replace("arms.a", 'arms."../a"'), "a name holds letters, digits and dashes"),
    ],
)
def test_refusals(text, hint):
    with pytest.raises(SettingsError) as caught:
        experiment.parse("mine", text)
    assert hint in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


def test_files_that_cannot_be_read(tmp_path):
    (tmp_path / "bytes.toml").write_bytes(b"\xff\xfe")
    (tmp_path / "wrong.toml").write_text(HEAD)
    for name, said in (
        ("none", r"none\.toml: No such file"),
        ("bytes", "not UTF-8"),
        ("wrong", r"wrong\.toml: an experiment needs"),
    ):
        with pytest.raises(LanewiseError, match=said):
            experiment.load_file(tmp_path / f"{name}.toml")


def test_settings_of_an_arm_lose_against_the_users():
    found = experiment.parse("mine", HEAD + ARM + '[arms.a.settings]\n"single_level.worlds" = 4\n')
    (arm,) = found.arms
    assert found.settings(arm, "trap-10.9", {}).single_level.worlds == 4
    assert found.settings(arm, "trap-10.9", {}).scenario.trap_speed == 10.9
    assert found.settings(arm, "trap-10", {"single_level.worlds": 8}).single_level.worlds == 8
