"""A run trained with the user's own start, observation, reward and success."""

import jax.numpy as jnp
import pytest
from test_train import FLAGS

import lanewise
from lanewise import api
from lanewise.cli import main
from lanewise.errors import LanewiseError, RunError, SettingsError
from lanewise.runs import metrics


def hurry(settings, world, steering, accident):
    return jnp.where(accident, -2.0, 0.25)


def place_and_speed(settings, world):
    vehicles = world.vehicles
    return jnp.stack([vehicles.x[0] / 100.0, vehicles.y[0] / 4.0, vehicles.speed[0] / 15.0])


def started(world):
    return world.vehicles.x[0] > 0.0


def two_dimensional(settings, world):
    return jnp.zeros((2, 2))


def asks(settings, world, steering, accident):
    return -2.0 if accident else 0.25


PARTS = lanewise.Parts(observe=place_and_speed, reward=hurry, success=started)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Both steps."""
    path = tmp_path_factory.mktemp("own") / "run"
    assert lanewise.train(path, parts=PARTS, seed=2, **FLAGS) == path
    return path


@pytest.mark.slow
def test_it_is_trained_and_tested_with_them(run):
    episodes = [r for r in metrics.read(run / "metrics.jsonl") if r["kind"] == "episode"]
    for episode in episodes:
        paid = 0.25 * episode["decisions"] - (2.25 if episode["accident"] != "none" else 0.0)
        assert episode["reward"] == pytest.approx(paid)
        assert episode["success"] == (episode["accident"] == "none")
    found = lanewise.evaluate(run, parts=PARTS, episodes=4)
    assert (found.episodes.success == (found.episodes.accident == 0)).all()
    assert found.record(0).controller == "hierarchical"


@pytest.mark.slow
def test_it_is_not_mistaken_for_another(run, capsys, tmp_path):
    with pytest.raises(RunError, match=r"made with observe: test_own_parts\.place_and_speed; rew"):
        lanewise.evaluate(run)
    with pytest.raises(RunError, match="give the same functions"):
        lanewise.evaluate(run, parts=lanewise.Parts(reward=hurry))
    assert main(["evaluate", str(run)]) == 2
    assert "test_own_parts.hurry" in capsys.readouterr().err
    with pytest.raises(RunError, match="no parts of the user's own"):
        lanewise.evaluate("pretrained/single-level", parts=PARTS)
    with pytest.raises(RunError, match="finished"):
        lanewise.train(run, parts=PARTS, resume=True)


@pytest.mark.parametrize("quiet", [False, True])
def test_progress_is_told_unless_quiet_is_asked(tmp_path, monkeypatch, capsys, quiet):
    def trained(folder, lender, reporter, **given):
        reporter.stage("step 1", 10)
        reporter.note("a warning")

    monkeypatch.setattr(api.training, "train", trained)
    lanewise.train(tmp_path / "run", quiet=quiet)
    told = capsys.readouterr().err
    assert "a warning" in told
    assert ("step 1" in told) != quiet


def test_mistakes_leave_nothing_behind(tmp_path):
    for given, said in (
        ({"controller": "hierarchcal"}, "did you mean hierarchical"),
        ({"warm_up": 3}, "may be single_level.learner.warm_up, .* give it in full"),
        ({"scenario": {"trap_sped": 3.0}}, "unknown setting"),
        ({"seed": "3"}, 'seed: expected a whole number, got "3"'),
        ({"seed": -1}, "seed must be between 0 and 2147483647, got -1"),
        ({"seed": True}, "seed: expected a whole number, got true"),
        ({"parts": None}, "parts: expected lanewise.Parts"),
        ({"preset": 3}, "preset: expected text, one of quick, paper, ranges"),
    ):
        with pytest.raises(SettingsError, match=said):
            lanewise.train(tmp_path / "run", **given)
    assert not (tmp_path / "run").exists()
    with pytest.raises(SettingsError, match=r"seed: expected a whole number, got 1\.5"):
        lanewise.evaluate(lambda seen: 4, seed=1.5)
    with pytest.raises(SettingsError, match=r"parts: expected lanewise\.Parts"):
        lanewise.evaluate("pretrained/single-level", parts=3)
    for given, said in (
        ({"parts": lanewise.Parts(reward=asks)}, "reward: asks fails: .* jnp.where"),
        ({"controller": "single-level", "high_level": "a"}, "only hierarchical and planned"),
        ({"high_level": tmp_path / "none"}, "no run in"),
    ):
        with pytest.raises(LanewiseError, match=said):
            lanewise.train(tmp_path / "run", **given)
    assert not (tmp_path / "run").exists()
    (tmp_path / "file").write_text("")
    with pytest.raises(LanewiseError, match="cannot write"):
        lanewise.train(tmp_path / "file" / "run")


@pytest.mark.parametrize(
    ("part", "function", "said"),
    [
        (
            "observe",
            two_dimensional,
            r"must return a float32 vector, not float32 of shape \(2, 2\)",
        ),
        ("observe", lambda settings, world: [1.0], "must return a float32 vector, not a list"),
        ("reward", lambda s, world, *rest: world.vehicles.x, r"one number, not float32 of shape"),
        ("reward", lambda settings, world: 1.0, "fails: .* takes 2 positional arguments but 4"),
        ("reward", asks, "reward: asks fails: .* use jnp.where instead of if"),
        ("success", lambda world: world.vehicles.x[0], "must return one bool, not float32"),
        ("start", lambda *given: 3, "must return a World, not int32"),
    ],
)
def test_wrong_functions_are_refused_by_name_before_anything_is_driven(part, function, said):
    with pytest.raises(SettingsError, match=said) as caught:
        lanewise.evaluate(lambda seen: 4, parts=lanewise.Parts(**{part: function}))
    assert len(str(caught.value).splitlines()) == 1
