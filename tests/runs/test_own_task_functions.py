"""A run trained with the user's own start, observation, reward and success."""

import dataclasses
import sys
from functools import partial
from importlib.machinery import ModuleSpec
from types import ModuleType

import jax
import jax.numpy as jnp
import pytest
import small_runs

import lanewise
from lanewise import config
from lanewise.driving.settings import DrivingSettings
from lanewise.errors import RunError, SettingsError
from lanewise.runs import metrics_file
from lanewise.runs.run_folder import RunFolder
from lanewise.scenario import trap
from lanewise.scenario.settings import TrapSettings

FLAGS = small_runs.flags(chunks=5)


def hurry(settings, world, steering, accident):
    return jnp.where(accident, -2.0, 0.25)


def place_and_speed(settings, world):
    vehicles = world.vehicles
    return jnp.stack([vehicles.x[0] / 100.0, vehicles.y[0] / 4.0, vehicles.speed[0] / 15.0])


def speed_alone(settings, world):
    return world.vehicles.speed[:1]


def started(world):
    return world.vehicles.x[0] > 0.0


def two_dimensional(settings, world):
    return jnp.zeros((2, 2))


def asks(settings, world, steering, accident):
    return -2.0 if accident else 0.25


def with_whole_places(settings, key, split):
    world = trap.sample(settings, key, split)
    whole = world.vehicles.x.astype(jnp.int32)
    return dataclasses.replace(world, vehicles=dataclasses.replace(world.vehicles, x=whole))


def fewer_in_tests(settings, key, split):
    world = trap.sample(settings, key, split)
    if split != "test":
        return world
    fewer = jax.tree.map(lambda leaf: leaf[:2], (world.drivers, world.vehicles))
    return dataclasses.replace(world, drivers=fewer[0], vehicles=fewer[1])


def all_places(settings, world):
    return world.vehicles.x


class FailsLater:
    """Of the traces of a training, all but the first are refused."""

    def __init__(self, traces):
        self.left = traces

    def __call__(self, settings, world, steering, accident):
        self.left -= 1
        assert self.left >= 0, "once too often"
        return jnp.where(accident, -2.0, 0.25)


@dataclasses.dataclass(frozen=True)
class Weighted:
    """A reward with a setting of its own."""

    weight: float
    given: object = None

    def __call__(self, settings, world, steering, accident):
        return jnp.where(accident, -self.weight, 0.25)


@dataclasses.dataclass
class Unhashable:
    weight: float

    def __call__(self, *given):
        return jnp.float32(self.weight)


def weighted(weight, settings, world, steering, accident, more=0.0):
    return jnp.where(accident, -weight, more)


PARTS = lanewise.TaskFunctions(observe=place_and_speed, reward=hurry, success=started)


@pytest.mark.slow
def test_a_run_is_trained_and_tested_with_them_and_not_mistaken_for_another(
    tmp_path, capsys, refused
):
    run = tmp_path / "run"
    assert lanewise.train(run, "single-level", task=PARTS, seed=2, **FLAGS) == run
    episodes = [r for r in metrics_file.read(run / "metrics.jsonl") if r["kind"] == "episode"]
    for episode in episodes:
        paid = 0.25 * episode["decisions"] - (2.25 if episode["accident"] != "none" else 0.0)
        assert episode["reward"] == pytest.approx(paid)
        assert episode["success"] == (episode["accident"] == "none")
    found = lanewise.evaluate(run, task=PARTS, episodes=4)
    assert (found.episodes.success == (found.episodes.accident == 0)).all()
    with pytest.raises(
        RunError, match=r"made with observe: test_own_task_functions\.place_and_speed; rew"
    ):
        lanewise.evaluate(run)
    assert "test_own_task_functions.hurry" in refused("evaluate", run)
    lanewise.evaluate(run, task=lanewise.TaskFunctions(observe=place_and_speed), episodes=4)
    differs = "reward test_own_task_functions.hurry (here the paper's), success test_own_task_fun"
    assert f"single-level was trained on {differs}" in capsys.readouterr().err
    with pytest.raises(RunError, match=r"\(3, 16\).*\n  the run was made with observe: test_own"):
        lanewise.evaluate(run, task=lanewise.TaskFunctions(observe=speed_alone))
    with pytest.raises(RunError, match="finished"):
        lanewise.train(run, "single-level", task=PARTS, resume=True)


@pytest.mark.parametrize(
    ("task", "said"),
    [
        (
            {"start": fewer_in_tests, "observe": all_places},
            r"observe: all_places returns \d+ numbers in training and 2 in test",
        ),
        (
            {"reward": FailsLater(6)},
            r"reward: test_own_task_functions.FailsLater \(in a training\) fails: once too often",
        ),
    ],
    ids=["lengths", "seventh trace"],
)
def test_parts_are_tried_in_full_before_a_run_is_made(tmp_path, task, said):
    given = {"task": lanewise.TaskFunctions(**task), "quiet": True}
    with pytest.raises(SettingsError, match=said) as refused:
        lanewise.train(tmp_path / "run", "single-level", **given, **FLAGS)
    assert len(str(refused.value).splitlines()) == 1
    assert not (tmp_path / "run").exists()


def test_a_lender_with_other_parts_is_refused_before_a_run_is_made(tmp_path, refused):
    lender = tmp_path / "lender"
    RunFolder.create(lender, config.compose(), "planned", 0, PARTS.names()).close()
    (lender / "stages").mkdir()
    (lender / "stages" / "step-1.json").write_text("{}")
    run = tmp_path / "run"
    with pytest.raises(RunError, match="was made with observe: "):
        lanewise.train(run, high_level_of=lender)
    with pytest.raises(RunError, match=r"has no step 1 .* only hierarchical and planned"):
        lanewise.train(run, "single-level", high_level_of=lender)
    said = refused("train", "hierarchical", "--out", run, "--high-level", lender)
    assert "was made with observe: " in said
    assert not run.exists()
    with pytest.raises(RunError, match=r"give the same functions, not reward: mine\.hurry"):
        RunFolder.open(lender).check_parts(("reward: mine.hurry",))


def test_functions_of_every_kind_have_a_name_that_stays():
    for function, name in (
        (weighted, "weighted"),
        (partial(weighted, 2.0), "weighted(2.0)"),
        (partial(weighted, 2.0, more=0.5), "weighted(2.0, more=0.5)"),
        (partial(partial(weighted, 2.0), more=jnp.zeros(3)), "weighted(2.0, more=ArrayImpl)"),
        (Weighted(0.5), "Weighted(weight=0.5, given=None)"),
        (Weighted(0.5, "a\n" * 100), "Weighted(weight=0.5, given='a\\n" + "a\\n" * 25),
        (FailsLater(3), "FailsLater"),
        (Weighted(0.5).__call__, "Weighted.__call__"),
        (jax.jit(hurry), "hurry"),
    ):
        (found,) = lanewise.TaskFunctions(reward=function).names()
        assert found.startswith(f"reward: test_own_task_functions.{name}")
    task = lanewise.TaskFunctions(reward=partial(weighted, 2.0))
    assert task.validate(TrapSettings(), DrivingSettings()) == 26


def test_functions_of_a_script_are_called_as_where_it_is_imported(monkeypatch):
    script = ModuleType("__main__")
    monkeypatch.setitem(sys.modules, "__main__", script)
    monkeypatch.setattr(hurry, "__module__", "__main__")
    task = lanewise.TaskFunctions(reward=hurry)
    assert task.names() == ("reward: __main__.hurry",)  # in a notebook
    script.__file__ = "/somewhere/mine.py"
    assert task.names() == ("reward: mine.hurry",)
    script.__spec__ = ModuleSpec("tools.mine", None)  # python -m tools.mine
    assert task.names() == ("reward: tools.mine.hurry",)


def test_what_cannot_be_compiled_with_is_refused_when_parts_are_made():
    with pytest.raises(SettingsError, match=r"reward: Unhashable.* cannot be hashed; .*frozen=Tr"):
        lanewise.TaskFunctions(reward=Unhashable(0.5))
    with pytest.raises(SettingsError, match="reward: expected a function, got None"):
        lanewise.TaskFunctions(reward=None)


def test_wrong_functions_are_refused_by_name_before_anything_is_driven():
    for part, function, said in (
        ("observe", two_dimensional, r"return a float32 vector, not float32 of shape \(2, 2\)"),
        ("reward", lambda *given: 0.25j, r"one real number, not complex64 of shape \(\)"),
        ("reward", partial(weighted, 2j), r"^reward: weighted\(complex\) must return one real"),
        ("reward", asks, "reward: asks fails: .* use jnp.where instead of if"),
        ("success", lambda world: world.vehicles.x[0], "must return one bool, not float32"),
        ("start", with_whole_places, r"vehicles.x as float32 of shape \(12,\), not int32 of shape"),
    ):
        with pytest.raises(SettingsError, match=said) as caught:
            lanewise.evaluate(lambda seen: 4, task=lanewise.TaskFunctions(**{part: function}))
        assert len(str(caught.value).splitlines()) == 1
