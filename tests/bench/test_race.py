"""The race searches settings that exist, around the defaults."""

import json
import sys

import pytest
import race

from lanewise import config
from lanewise.runs.run_folder import RunFolder
from lanewise.system import version


@pytest.mark.parametrize("controller", race.SPACES)
def test_what_is_tried(controller):
    """Settings that exist, the defaults among them, as often as the hierarchical one's were."""
    defaults = config.compose()
    for name, values in race.SPACES[controller].items():
        assert config.flatten(defaults)[name] in values, name
        for value in values:
            config.compose(flags={name: value})
    tried = race.settings_of(controller)
    assert tried == race.settings_of(controller)
    settings = [config.compose(flags=changes) for changes in tried]
    digests = {config.digest(each) for each in settings}
    assert len(digests) == len(tried) == 37 - race.BEST * len(race.MORE_SEEDS)
    assert config.digest(defaults) in digests
    # The step size falls as long as there are updates.
    for each in settings:
        budget = each.single_level if controller == "single-level" else each.h_dqn
        levels = [budget] if controller == "single-level" else [budget.high_level, budget.low_level]
        for level in levels:
            updates = budget.decisions * level.updates_per_step
            assert level.learner.learning_rate_decay == pytest.approx(updates, rel=1e-3)


def test_the_best_go_on_and_nothing_is_trained_twice(tmp_path, monkeypatch):
    """With trainings that leave nothing but how good they are: settings 3 and 1 are best."""
    trained = []

    def train(runs, processes, stream, out):
        for run in runs:
            if not run.done:
                trained.append((run.arm, run.seed))
                leave(run, {1: 0.7, 3: 0.9}.get(int(run.arm[-2:]), 0.1))

    def leave(run, success):
        with RunFolder.create(run.path, run.settings, run.controller, run.seed) as folder:
            weights = {
                "kind": "weights",
                "stage": run.controller,
                "rule": "last",
                **dict.fromkeys(("kept_chunk", "last_chunk", "fresh_episodes"), 1),
                "kept_success_rate": success,
                "kept_accident_rate": 0.0,
                "kept_reward": 1.0,
            }
            folder.metrics.write_text(json.dumps(weights) + "\n")
            (run.path / "controller.json").write_text("{}")

    monkeypatch.setattr(race, "DRAWN", 3)
    monkeypatch.setattr(race, "BEST", 2)
    monkeypatch.setattr(race.schedule, "run", train)
    monkeypatch.setattr(race.run_state, "weights_digest", lambda folder: "")
    monkeypatch.setattr(sys, "argv", ["race.py", "--out", str(tmp_path), "--controllers", "h-dqn"])
    race.main()
    again = [(f"h-dqn {number:02d}", seed) for number in (3, 1) for seed in (1, 2, 3)]
    assert trained == [(f"h-dqn {number:02d}", 0) for number in range(4)] + again
    rows = json.loads((tmp_path / "race.json").read_text())["rows"]
    assert len(rows) == 10
    assert all(row["trained_by"] == version.source() for row in rows)
    race.main()
    assert len(trained) == 10
