"""Settings: how they are composed, what is refused, and in which words."""

import itertools
import re
from pathlib import Path

import pytest

from lanewise import config
from lanewise.config import validation
from lanewise.config.settings import ONE_LEVEL_STAGES, PRESETS, TRAPS, Settings
from lanewise.errors import LanewiseError, SettingsError


def from_toml(text):
    """The settings of a TOML text by dotted name."""
    return config.load_toml(Path("test.toml"), text.replace("; ", "\n").encode())


def test_presets_are_valid_and_survive_toml(tmp_path):
    file = tmp_path / "settings.toml"
    for preset, trap in itertools.product(PRESETS, TRAPS):
        settings = config.compose(preset, trap)
        file.write_text(config.dump_toml(settings))
        assert config.compose(file=file) == settings


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


BEHIND = "scenario.traffic.vehicles_behind = 1; "


@pytest.mark.parametrize(
    ("text", "hint"),
    [
        ("goals.lowest_speed = 17.0", "at most goals.highest_speed (16.0), got 17.0"),
        ("scenario.training_ego_speed = [9.0, 8.0]", "9.0 must not exceed 8.0"),
        ("scenario.training_ego_speed = [2, 9]; driving.stopped_speed = 2.5", "(2.5), got 2.0"),
        ("scenario.test_front_distance = 5.0", "more than a car length (5.0 m), got 5.0"),
        ("scenario.traffic.spacing = 8.0", "spacing minus scenario.traffic.spacing_jitter must"),
        (BEHIND + "scenario.test_side_distance = -35", "test_side_distance must be more than -35"),
        ("scenario.training_spacing = [8.0, 30.0]", "scenario.training_spacing minus scenario."),
        (BEHIND + "scenario.training_gap_behind = [10, 45]", "training_gap_behind minus scenario."),
        (
            "scenario.training_vehicles_behind = [0, 1]; scenario.training_gap_behind = [12, 45]; "
            "scenario.training_side_distance = [-2.0, 5.0]",
            "scenario.training_side_distance must be more than -2.0 m, or the trap car stands "
            "among the traffic behind: scenario.training_gap_behind less",
        ),
        # Without a range in training, the value of the tests counts.
        (BEHIND + "scenario.training_side_distance = [-35, 5]", "scenario.traffic.gap_behind less"),
        (
            "scenario.trap_speed = 8.0; scenario.trap_speed_wave = 8.0",
            "scenario.trap_speed_wave must be less than the lowest speed of the trap (8.0 m/s), "
            "or trap cars drive backwards; got 8.0",
        ),
        (
            "scenario.training_trap_speed = [6, 12]; scenario.training_trap_speed_wave = [0, 7]",
            "scenario.training_trap_speed_wave must be less than the lowest speed of the trap (6.0",
        ),
        ("scenario.training_trap_speed_wave = [0.0, 10.0]", "the lowest speed of the trap (10.0"),
        ("scenario.training_trap_speed = [6, 12]; scenario.trap_speed_wave = 7", "the trap (6.0"),
        ("driving.latency = 0.46", "driving.latency in whole ticks must be less than a decision"),
        ("driving.training_latency = [0.0, 0.5]", "less than a decision (0.5 s), got [0.0, 0.5]"),
        ("driving.training_latency = [0.3, 0.1]", "training_latency: 0.3 must not exceed 0.1"),
        ("driving.observation.training_noise = [0.2, 0.1]", "noise: 0.2 must not exceed 0.1"),
        ("goals.lowest_speed = 0.1", "stopped_speed must be less than goals.lowest_speed (0.1)"),
        ("goals.speed_tolerance = 1.0", "must be less than goals.speed_step (1.0)"),
        (
            "driving.reward = {speed_weight = 0, steering_weight = 0, centring_weight = 0}",
            "driving.reward.centring_weight are all 0: there is nothing to reward",
        ),
        ("low_level.exploration.end = 0.6", "at most low_level.exploration.start (0.5), got 0.6"),
        ("high_level.decisions = 1000", "warm_up must be less than high_level.decisions (1000)"),
        ("single_level.external_weight = 0", "external_weight is 0: there would never be"),
        ("low_level.learner.batch_size = 60000", "learner.replay_capacity (50000), got 60000"),
        ("high_level.decisions = 0", "training would never end"),
        (f"high_level.learner.hidden = {[8] * 17}", "hidden: at most 16 layers, got 17"),
        ("evaluation.duration = 5000", "in 5000 s a vehicle could get 200,306 m from the start"),
    ],
)
def test_settings_that_contradict_one_another(text, hint):
    with pytest.raises(SettingsError, match=re.escape(hint)):
        config.compose(flags=from_toml(text))


def test_settings_that_only_seem_to_contradict():
    for text in (
        # Without a decay there is but one rate; a level may learn from its goals' rewards alone.
        "high_level.learner.learning_rate = 5e-5; high_level.learner.learning_rate_decay = 0",
        "low_level.external_weight = 0",
        "scenario.test_side_distance = -60",
        # The ranges of training stand in place of the test's speed and wave.
        "scenario.trap_speed_wave = 9.0; scenario.training_trap_speed = [6.0, 12.0]; "
        "scenario.training_trap_speed_wave = [0.0, 5.0]",
        # To the nearest tick it is less than a decision.
        "driving.latency = 0.44",
    ):
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


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("trap_speed", "did you mean scenario.trap_speed?"),
        ("low_level.batch_size", "did you mean low_level.learner.batch_size"),
        ("zzz", "`lanewise train --help` lists all"),
    ],
)
def test_unknown_names_are_refused_with_the_nearest_right_one(name, hint):
    with pytest.raises(SettingsError, match=f'^unknown setting "{name}"; {re.escape(hint)}'):
        config.compose(flags={name: 1})


def test_unknown_presets_are_refused_with_the_nearest_right_one():
    with pytest.raises(SettingsError, match='unknown preset "qick"; did you mean quick'):
        config.compose("qick")


@pytest.mark.parametrize(
    ("content", "hint"),
    [
        (b"# \xff\n", "not valid TOML: not UTF-8 text"),
        (b"scenario = 3\n", "scenario is a section, not a setting"),
        (b"[scenario.lanes]\nx = 1\n", "scenario.lanes: expected a whole number"),
        (b"[zzz]\n", 'unknown section "zzz"; known: scenario, scenario.traffic'),
        (b"[scenario]\ntrap_speed = 9\ntrap-speed = 8\n", "scenario.trap_speed is given twice"),
    ],
)
def test_bad_toml_files(tmp_path, content, hint):
    file = tmp_path / "bad.toml"
    file.write_bytes(content)
    with pytest.raises(LanewiseError, match=re.escape(hint)):
        config.compose(file=file)


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
