"""Settings: how they are composed, what is refused, and in which words."""

import dataclasses
import math
import tomllib
from pathlib import Path

import pytest

from lanewise import config
from lanewise.config import validation
from lanewise.config.settings import ONE_LEVEL_STAGES, PRESETS, TRAPS, Settings
from lanewise.errors import SettingsError
from lanewise.fields.ranges import Between
from lanewise.runs.run_folder import RunFolder
from lanewise.system import process


def refusal(flags):
    """The message with which settings are refused, given by dotted name."""
    with pytest.raises(SettingsError) as caught:
        config.compose(flags=flags)
    message = str(caught.value)
    assert len(message.splitlines()) <= 2
    return message


def from_toml(text):
    """The settings of a TOML text by dotted name."""
    return config.load_toml(Path("test.toml"), text.replace("; ", "\n").encode())


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("trap", TRAPS)
def test_presets_are_valid_and_survive_toml(preset, trap, tmp_path):
    settings = config.compose(preset, trap)
    file = tmp_path / "settings.toml"
    file.write_text(config.dump_toml(settings))
    assert config.compose(file=file) == settings


def test_toml_holds_every_setting_once():
    table = tomllib.loads(config.dump_toml(Settings()))
    leaves = [line for line in config.dump_toml(Settings()).splitlines() if " = " in line]
    assert len(leaves) == len(config.field_types())
    assert table["scenario"]["traffic"]["driver"]["time_gap"] == 1.5
    assert table["scenario"]["training_trap_speed"] == []


@pytest.mark.parametrize("stage", [*ONE_LEVEL_STAGES, "h_dqn"])
def test_paper_preset_adds_nothing_to_the_method(stage):
    """One world and an update a decision; goals last till achieved; the external reward alone."""
    paper = config.compose("paper")
    budget = getattr(paper, stage)
    assert (budget.worlds, budget.duration, budget.decisions) == (1, 250, 0)
    assert budget.episodes == (1000 if stage == "high_level" else 2000)
    levels = (budget,) if stage != "h_dqn" else (budget.high_level, budget.low_level)
    for level in levels:
        assert (level.updates_per_step, level.exploration.steps) == (1.0, 1000)
        # What a preset does not mention keeps its default.
        assert (level.learner.discount, level.learner.learning_rate) == (0.8, 1e-3)
        assert (level.learner.batch_size, level.learner.replay_capacity) == (64, 50_000)
    low = paper.low_level
    assert (low.tracking_weight, low.approach_weight, low.goal_reward) == (0.0, 0.0, 0.0)
    # No goal is given up: an episode is shorter than the limit.
    assert paper.driving.decisions_in(paper.goals.time_limit) > budget.duration


def test_later_layers_win(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text("[scenario]\ntrap-speed = 9\n[high_level]\nepisodes = 7\n")
    from_file = config.compose("paper", "trap-10.9", file)
    assert (from_file.scenario.trap_speed, from_file.high_level.episodes) == (9.0, 7)
    assert type(from_file.scenario.trap_speed) is float
    flagged = config.compose("paper", "trap-10.9", file, {"scenario.trap_speed": 8.5})
    assert flagged.scenario.trap_speed == 8.5
    assert config.compose("paper", "trap-10.9").scenario.trap_speed == 10.9


def test_digest_follows_values_not_how_they_were_given():
    base = config.digest(Settings())
    assert config.digest(config.compose(flags={"scenario.trap_speed": 10})) == base
    assert config.digest(config.compose(flags={"scenario.trap_speed": 10.1})) != base


HUGE = pytest.param(10**5000, id="huge")


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, -3.0, 0, 1e9, HUGE])
def test_a_number_must_be_finite_and_in_range(value):
    message = refusal({"scenario.trap_speed": value})
    assert message.startswith("scenario.trap_speed must be between 0.5 and 40 m/s, got ")


@pytest.mark.parametrize(
    ("name", "values", "hint"),
    [
        ("scenario.lanes", [True, 3.0, "3", None, [3]], "expected a whole number, got "),
        ("scenario.trap_speed", [True, "10", None, [10.0]], "expected a number, got "),
        ("scenario.missing_target_speed", [1, 0, "true"], "expected true or false, got "),
        ("goals.reference", ["nowhere", ""], "must be one of previous-goal, current-state, got "),
        ("goals.reference", [3, None], "expected one of previous-goal, current-state, got "),
        (
            "scenario.training_front_distance",
            [[15.0], [15.0] * 3, 15.0, "ab"],
            "expected 2 numbers, got",
        ),
        ("scenario.training_front_distance", [[15.0, True]], "expected a number, got true"),
        ("scenario.training_front_distance", [[15.0, math.nan]], "between 5 and 200 m, got nan"),
        ("scenario.training_lanes", [[3], 3], "expected 2 whole numbers or none, got"),
        ("scenario.training_lanes", [[3, 9]], "must be between 2 and 8, got 9"),
        ("high_level.learner.hidden", [[]], "expected one or more whole numbers, got []"),
        ("high_level.learner.hidden", [[512, 0]], "must be between 1 and 65536, got 0"),
    ],
)
def test_values_of_a_wrong_type(name, values, hint):
    for value in values:
        message = refusal({name: value})
        assert message.startswith(name)
        assert hint in message


@pytest.mark.parametrize(
    ("text", "hint"),
    [
        ("driving.decision_frequency = 11", "at most driving.simulation_frequency (10), got 11"),
        ("goals.lowest_speed = 17.0", "at most goals.highest_speed (16.0), got 17.0"),
        ("scenario.training_ego_speed = [9.0, 8.0]", "9.0 must not exceed 8.0"),
        (
            "scenario.training_ego_speed = [2.0, 9.0]; driving.stopped_speed = 2.5",
            "scenario.training_ego_speed must be more than driving.stopped_speed (2.5), got 2.0",
        ),
        ("scenario.test_front_distance = 5.0", "more than a car length (5.0 m), got 5.0"),
        ("scenario.training_front_distance = [5.0, 15.0]", "more than a car length (5.0 m)"),
        ("scenario.traffic.spacing = 8.0", "spacing minus scenario.traffic.spacing_jitter must"),
        (
            "scenario.traffic.vehicles_behind = 2; scenario.traffic.gap_behind = 2.0",
            "gap_behind minus scenario.traffic.spacing_jitter must be more than a car length",
        ),
        (
            "scenario.traffic.first_gap = 9.0; scenario.traffic.spacing_jitter = 4.5",
            "first_gap minus scenario.traffic.spacing_jitter must be more than a car length (5.0 m)"
            ", got 4.5",
        ),
        (
            "scenario.traffic.vehicles_behind = 1; scenario.test_side_distance = -35.0",
            "scenario.test_side_distance must be more than -35.0 m, or the trap car stands among",
        ),
        (
            "scenario.traffic.vehicles_behind = 1; scenario.training_side_distance = [-60, 5]",
            "scenario.training_side_distance must be more than -35.0 m",
        ),
        (
            "goals.lowest_speed = 0.1",
            "driving.stopped_speed must be less than goals.lowest_speed (0.1), or goals ask for",
        ),
        ("goals.lateral_tolerance = 4.0", "must be less than scenario.lane_width (4.0)"),
        ("goals.speed_tolerance = 1.0", "must be less than goals.speed_step (1.0)"),
        (
            "driving.reward = {speed_weight = 0, steering_weight = 0, centring_weight = 0}",
            "driving.reward.centring_weight are all 0: there is nothing to reward",
        ),
        (
            "low_level.exploration.end = 0.6",
            "low_level.exploration.end must be at most low_level.exploration.start (0.5), got 0.6",
        ),
        (
            "h_dqn.low_level.learner.learning_rate = 5e-5",
            "final_learning_rate must be at most h_dqn.low_level.learner.learning_rate (5e-05)",
        ),
        (
            "high_level.decisions = 1000",
            "high_level.learner.warm_up must be less than high_level.decisions (1000), or training",
        ),
        ("single_level.external_weight = 0", "external_weight is 0: there would never be"),
        (
            "low_level.external_weight = 0; low_level.tracking_weight = 0",
            "low_level.external_weight, tracking_weight, approach_weight, goal_reward are all 0",
        ),
        ("scenario.ego_speed = 5; driving.stopped_speed = 5", "driving.stopped_speed (5.0)"),
        (
            "low_level.learner.batch_size = 60000",
            "at most low_level.learner.replay_capacity (50000), got 60000",
        ),
        ("low_level.learner.warm_up = 60000", "low_level.learner.warm_up must be at most"),
        ("low_level.worlds = 60000", "low_level.worlds must be at most"),
        ("high_level.decisions = 0", "training would never end"),
        (f"high_level.learner.hidden = {[8] * 17}", "hidden: at most 16 layers, got 17"),
        (
            "evaluation.duration = 5000",
            "evaluation.duration: in 5000 s a vehicle could get 200,306 m from the start",
        ),
        ("low_level.duration = 7000", "in 3500 s a vehicle could get 140,306 m"),
        (
            "scenario.traffic = {spacing = 1000, vehicles_behind = 100, spacing_jitter = 900, "
            "first_gap = 950, gap_behind = 950}",
            "scenario.traffic: the farthest vehicle could stand 189,950 m from the ego",
        ),
    ],
)
def test_settings_that_contradict_one_another(text, hint):
    assert hint in refusal(from_toml(text))


@pytest.mark.parametrize(
    "text",
    [
        # Without a decay there is but one rate; a level may learn from its goals' rewards alone.
        "high_level.learner.learning_rate = 5e-5; high_level.learner.learning_rate_decay = 0",
        "low_level.external_weight = 0",
        "high_level.decisions = 0; high_level.episodes = 1",
        "scenario.test_side_distance = -60",
        "evaluation.duration = 3000",
        "scenario.traffic.spacing = 200; scenario.traffic.vehicles_ahead = 100",
        "scenario.traffic.vehicles_ahead = 0; scenario.traffic.first_gap = 0",
    ],
)
def test_settings_that_only_seem_to_contradict(text):
    config.compose(flags=from_toml(text))


def test_memory_is_needed_by_the_stages_that_are_trained():
    wide = config.compose(flags={"low_level.learner.hidden": [65_536, 65_536]})
    with pytest.raises(SettingsError, match=r"^low_level\.learner\.hidden and replay_capacity"):
        validation.check_memory(wide, "hierarchical", 24 << 30)
    validation.check_memory(wide, "hierarchical", 81 << 30)
    validation.check_memory(wide, "planned", 24 << 30)
    validation.check_memory(wide, "hierarchical", None)
    long = config.compose(flags={"h_dqn.high_level.learner.replay_capacity": 10_000_000})
    with pytest.raises(SettingsError, match=r"^h_dqn\.high_level\.learner.*need at least 2\.0 GiB"):
        validation.check_memory(long, "h-dqn", 1 << 30)
    with pytest.raises(SettingsError, match=r"need at least .* 60,000 numbers are observed"):
        validation.check_memory(Settings(), "planned", 1 << 30, 60_000)


def test_no_run_begins_that_memory_cannot_hold(tmp_path, monkeypatch):
    monkeypatch.setattr(process, "total_memory", lambda: 1 << 20)
    with pytest.raises(SettingsError, match="GiB of memory, the machine has"):
        RunFolder.create(tmp_path / "run", Settings(), "planned", 0)
    assert list(tmp_path.iterdir()) == []


def test_replace_checks_settings_built_without_compose():
    scenario = dataclasses.replace(Settings().scenario, lane_width=math.nan)
    with pytest.raises(SettingsError, match=r"scenario\.lane_width must be .* got nan"):
        config.replace(Settings(scenario=scenario), {})


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("scenario.trap_sped", "did you mean scenario.trap_speed?"),
        ("trap_speed", "did you mean scenario.trap_speed?"),
        ("senario.lanes", "did you mean scenario.lanes?"),
        ("low_level.batch_size", "did you mean low_level.learner.batch_size"),
        ("high_level.learner.learningrate", "did you mean high_level.learner.learning_rate?"),
        ("driving.trap_speed", "did you mean scenario.trap_speed?"),
        ("scenario.steering_limit", "did you mean scenario.traffic.driver.steering_limit?"),
        ("SCENARIO.Trap_Speed", "did you mean scenario.trap_speed?"),
        ("scenario/trapSpeed", "did you mean scenario.trap_speed?"),
        ("scenario.speed_trap", "did you mean scenario.trap_speed?"),
        ("zzz", "`lanewise train --help` lists all"),
    ],
)
def test_unknown_names_are_refused_with_the_nearest_right_one(name, hint):
    message = refusal({name: 1})
    assert message.startswith(f'unknown setting "{name}"')
    assert hint in message


@pytest.mark.parametrize(
    ("arguments", "hint"),
    [
        ({"preset": "qick"}, 'unknown preset "qick"; did you mean quick'),
        ({"preset": 3}, "preset: expected text, one of quick, paper, ranges, got 3"),
        ({"trap": "nothing"}, 'unknown trap "nothing"; known: trap-10, trap-10.9'),
        ({"file": 3}, "settings file: expected a path, got 3"),
        ({"flags": ["scenario.lanes"]}, "flags: expected a mapping of settings"),
    ],
)
def test_wrong_arguments_of_compose(arguments, hint):
    with pytest.raises(SettingsError) as caught:
        config.compose(**arguments)
    assert hint in str(caught.value)


@pytest.mark.parametrize(
    ("content", "hint"),
    [
        (b"[scenario\n", "not valid TOML"),
        (b"a = " + b"[" * 5000, "not valid TOML"),
        (b"# \xff\n", "not valid TOML: not UTF-8 text"),
        (b"#" * 1_000_001, "larger than"),
        (b"[scenario]\ntrap_sped = 9\n", "did you mean scenario.trap_speed?"),
        (b"[scenery]\ntrap_speed = 9\n", "did you mean scenario"),
        (b"scenario = 3\n", "scenario is a section, not a setting"),
        (b"[scenario.lanes]\nx = 1\n", "scenario.lanes: expected a whole number"),
        (b"[zzz]\n", 'unknown section "zzz"; known: scenario, scenario.traffic'),
        (b"[scenario]\ntrap_speed = nan\n", "must be between 0.5 and 40 m/s, got nan"),
        (b"[scenario]\ntrap_speed = 1979-05-27\n", "expected a number, got 1979-05-27"),
        (b"[scenario]\ntrap_speed = 9\ntrap-speed = 8\n", "scenario.trap_speed is given twice"),
        (b"[scenario]\nlanes = " + b"9" * 5000, "a whole number has too many digits"),
    ],
)
def test_bad_toml_files(tmp_path, content, hint):
    file = tmp_path / "bad.toml"
    file.write_bytes(content)
    with pytest.raises(SettingsError) as caught:
        config.compose(file=file)
    assert hint in str(caught.value)
    assert len(str(caught.value).splitlines()) <= 2


def test_unreadable_toml_files(tmp_path):
    for path, hint in ((tmp_path / "absent.toml", "No such file"), (tmp_path, "Is a directory")):
        with pytest.raises(SettingsError, match=f"cannot read settings file .*{hint}"):
            config.load_toml(path)


def test_differences_name_what_is_not_the_same_in_all():
    changes = ({}, {"scenario.lanes": 4}, {"scenario.lanes": 4, "goals.time_limit": 5.0})
    several = [config.compose(flags=each) for each in changes]
    assert config.differences(several) == {
        "scenario.lanes": (3, 4, 4),
        "goals.time_limit": (3.0, 3.0, 5.0),
    }
    assert config.differences(several[:1]) == {}
    assert config.first_difference(*several[:2]) == "scenario.lanes is 3, not 4"
    assert config.first_difference(several[0], several[0]) == ""


@pytest.mark.parametrize(
    ("bounds", "said"),
    [
        (Between(1.0, 2.5), "between 1 and 2.5"),
        (Between(1, 3, "m/s"), "between 1 and 3 m/s"),
    ],
)
def test_a_range_in_words(bounds, said):
    assert str(bounds) == said
    assert not any(bounds.holds(value) for value in (math.inf, math.nan, 10**400))


def test_every_number_has_a_range():
    for name, field_type in config.field_types().items():
        assert field_type.type not in (int, float) or field_type.bound is not None, name
