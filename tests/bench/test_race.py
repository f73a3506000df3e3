"""The race searches settings that exist, around the defaults."""

import json
import sys

import pytest
import race

from lanewise import config
from lanewise.runs.run_folder import RunFolder
from lanewise.system import version


@pytest.mark.parametrize("controller", ["single-level", "h-dqn"])
def test_every_setting_of_the_race_is_one(controller):
    defaults = config.flatten(config.compose())
    for name, values in race.SPACES[controller].items():
        assert defaults[name] in values, f"{name}: the default is not among what is tried"
        for value in values:
            config.compose(flags={name: value})


def test_both_get_as_many_trainings_as_the_hierarchical_controller_had():
    for controller in race.SPACES:
        tried = race.settings_of(controller)
        assert tried == race.settings_of(controller)
        digests = {config.digest(config.compose(flags=each)) for each in tried}
        assert len(digests) == len(tried) == 25
        assert config.digest(config.compose()) in digests
    assert len(tried) + race.BEST * len(race.MORE_SEEDS) == 37


@pytest.mark.parametrize("controller", ["single-level", "h-dqn"])
def test_the_step_size_falls_as_long_as_there_are_updates(controller):
    for changes in race.settings_of(controller):
        settings = config.compose(flags=changes)
        budget = settings.single_level if controller == "single-level" else settings.h_dqn
        levels = [budget] if controller == "single-level" else [budget.high_level, budget.low_level]
        for level in levels:
            updates = budget.decisions * level.updates_per_step
            assert level.learner.learning_rate_decay == pytest.approx(updates, rel=1e-3)


def test_the_best_go_on_and_nothing_is_trained_twice(tmp_path, monkeypatch):
    """With trainings that leave nothing but how good they are: settings 7, 8, 9 and 10 are best."""
    trained = []

    def train(runs, processes, stream, out):
        for run in runs:
            if not run.done:
                trained.append((run.arm, run.seed))
                good = {7: 0.7, 8: 0.9, 9: 0.8, 10: 0.6}.get(int(run.arm[-2:]), 0.1)
                leave(run, good)

    def leave(run, success):
        with RunFolder.create(run.path, run.settings, run.controller, run.seed) as folder:
            weights = {
                "kind": "weights",
                "stage": run.controller,
                "rule": "last",
                "kept_chunk": 1,
                "last_chunk": 1,
                "fresh_episodes": 9,
                "kept_success_rate": success,
                "kept_accident_rate": 0.0,
                "kept_reward": 1.0,
            }
            folder.metrics.write_text(json.dumps(weights) + "\n")
            (run.path / "controller.json").write_text("{}")

    monkeypatch.setattr(race.schedule, "run", train)
    monkeypatch.setattr(race.run_state, "weights_digest", lambda folder: "")
    monkeypatch.setattr(sys, "argv", ["race.py", "--out", str(tmp_path), "--controllers", "h-dqn"])
    race.main()
    assert len(trained) == len(set(trained)) == 37
    again = [(f"h-dqn {number:02d}", seed) for number in (8, 9, 7, 10) for seed in (1, 2, 3)]
    assert trained[25:] == again
    rows = json.loads((tmp_path / "race.json").read_text())["rows"]
    assert len(rows) == 37
    assert all(row["trained_by"] == version.source() for row in rows)
    race.main()
    assert len(trained) == 37
