"""A training whose numbers go wrong stops, keeps what was good, and can be seen again."""

import json

import jax.numpy as jnp
import numpy as np
import pytest
import small_runs

import lanewise
from lanewise.errors import NumbersError, RunError
from lanewise.runs import checkpoint, divergence, metrics_file
from lanewise.training.finite_checks import Finding

FLAGS = small_runs.flags(chunks=5)
pytestmark = pytest.mark.usefixtures("save_every_chunk")


def rarely(world):
    """Once in about a thousand decisions, told by the last digits of where a trap car is."""
    return jnp.floor(world.vehicles.x[1] * 4096.0) % 1009.0 == 7.0


def few_features(settings, world):
    vehicles = world.vehicles
    speed = jnp.where(rarely(world), jnp.nan, vehicles.speed[0] / 15.0)
    return jnp.stack([vehicles.x[0] / 100.0, vehicles.y[0] / 4.0, speed])


def failed(path, controller, task, **settings):
    """Train until it fails: the error."""
    long = {f"{controller.replace('-', '_')}.decisions": 4000}
    flags = FLAGS | {"evaluation.validation_interval": 100} | long | settings
    with pytest.raises(NumbersError, match=r"not finite.*; training stopped") as error:
        lanewise.train(path, controller, task=task, seed=1, **flags)
    return error.value


def check_what_is_left(path, task, what, stage):
    """Of the run: files that are whole, and the same failure seen again."""
    about = json.loads((path / divergence.FOLDER / divergence.FOUND).read_text())
    assert about["found_again"]
    assert about["found"][0]["what"] == what
    assert about["stage"] == stage
    assert about["seed"] == 1
    lines = metrics_file.read(path / "metrics.jsonl")
    chunks = [line["chunk"] for line in lines if line["kind"] == "chunk" and line["stage"] == stage]
    assert chunks == list(range(1, about["chunk"]))
    newest, problems = checkpoint.newest_valid(path / "checkpoints")
    assert problems == {}
    assert (newest.meta["counters"]["chunks"] if newest else 0) == about["chunk"] - 1
    assert not (path / "controller.json").exists()
    first = divergence.find_first_nonfinite(path, task)
    assert (first.stage, first.chunk) == (stage, about["chunk"])
    assert first.found[0].what == what
    return about, first


@pytest.mark.slow
def test_an_observation_that_is_not_finite(tmp_path):
    path, task = tmp_path / "run", lanewise.TaskFunctions(observe=few_features)
    error = failed(path, "single-level", task)
    about, first = check_what_is_left(path, task, "observation", "single-level")
    assert about["chunk"] > 1
    assert str(error).count("\n") == 1
    assert f"single-level, chunk {about['chunk']}: an observation is not finite" in str(error)
    told = about["found"][0]
    assert first.iteration == told["iteration"]
    wrong = np.argwhere(~np.isfinite(first.observation))
    assert [told["world"], 2] in wrong.tolist()
    before = {file: (path / file).read_bytes() for file in ("metrics.jsonl", "settings.toml")}
    with pytest.raises(NumbersError) as second:
        lanewise.train(path, "single-level", task=task, resume=True)
    assert str(second.value) == str(error)
    assert before == {file: (path / file).read_bytes() for file in before}


def huge(settings, world, steering, accident):
    """Finite itself, and beyond float32 once squared."""
    return jnp.where(accident, -1e30, 1e30)


@pytest.mark.slow
def test_a_loss_that_overflows(tmp_path):
    path, task = tmp_path / "run", lanewise.TaskFunctions(reward=huge)
    error = failed(path, "h-dqn", task)
    assert "the loss of high_level is not finite since decision" in str(error)
    assert "lower learner.learning_rate of high_level" in str(error)
    about, first = check_what_is_left(path, task, "loss", "h-dqn")
    assert not np.isfinite(first.loss["high_level"])
    np.testing.assert_allclose(np.abs(first.reward), 1e30, rtol=1e-3)
    assert {one["what"] for one in about["found"]} <= {"loss", "weights"}


def test_nothing_to_see_where_nothing_went_wrong(tmp_path):
    small_runs.create(tmp_path / "run", FLAGS, "single-level", 4).close()
    with pytest.raises(RunError, match="holds no training whose numbers went wrong"):
        divergence.find_first_nonfinite(tmp_path / "run")


def test_every_finding_has_its_advice():
    every = set(divergence.ADVICE) - {"validation"}
    assert len({Finding(what, "q").said(0, 1) for what in every}) == 6
