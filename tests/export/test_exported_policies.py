"""Exported policies, for NumPy and ONNX, against the JAX controller, and what is refused."""

import json
import shutil
import subprocess
import sys
from dataclasses import replace
from functools import cache
from zipfile import ZipFile

import jax
import jax.numpy as jnp
import numpy as np
import onnx
import pytest
from onnx.reference import ReferenceEvaluator

from lanewise import config
from lanewise.controllers import controller as controllers
from lanewise.driving.percept import Percept
from lanewise.export import check, contents, formats, numpy_policy, onnx_model
from lanewise.export.numpy_policy import Ego, load
from lanewise.export.recording import Graph, Value
from lanewise.learning.network import NormalisedLayer
from lanewise.runs.trained import Trained
from lanewise.training import recipe
from lanewise.world import road

CASES = {
    "hierarchical": {"goals.reference": "current-state", "goals.action_set": "joint-6"},
    "planned": {
        "goals.action_set": "single-5",
        "goals.time_limit": 1.5,
        "driving.actions.acceleration": 1.3,
    },
    "single-level": {},
    "single-level, held": {"single_level.hold": 3, "driving.observation.variant": "lanes"},
}
STEPS, BATCH, LANES = 30, 40, 5
EGO = Ego(y=4.0, heading=0.0, speed=10.0, lane_centres=[0.0, 4.0, 8.0])


@cache
def untrained(case):
    """A controller with random weights, large enough that its choices vary."""
    name = case.split(",")[0]
    settings = config.compose(preset="quick", trap="trap-10", file=None, flags=CASES[case])
    rng, parameters = np.random.default_rng(0), {}
    for level in recipe.evaluation_config(settings, name).controller.levels:
        parameters[level.name] = tuple(
            tuple(rng.uniform(-b, b, shape).astype(np.float32) for shape in ((n, m), (m,)))
            for n, m, b in ((level.feature_count, 32, 1.6), (32, level.choice_count, 0.2))
        )
        if case == "planned":
            first, *rest = parameters[level.name]
            parameters[level.name] = (NormalisedLayer(*first), *rest)
    return Trained(name, settings, 0, parameters)


@cache
def percepts(features):
    """[STEPS, BATCH] percepts of cars that wander over 3 to 5 lanes, often near a goal."""
    rng = np.random.default_rng(0)
    lanes = rng.integers(3, LANES + 1, BATCH)
    shape = (STEPS, BATCH)
    lane = np.clip(1 + rng.integers(-1, 2, shape).cumsum(0), 0, lanes - 1)
    numbers = {
        "y": 4.0 * lane + rng.choice([0.0, 0.1, -0.25, 1.0, -1.9], shape),
        "speed": 10.0 + 0.5 * np.clip(rng.integers(-1, 2, shape).cumsum(0), -12, 14),
        "heading": rng.choice([0.0, 0.002, -0.06, 0.1, 0.25], shape),
        "features": rng.uniform(-1.5, 1.5, (*shape, features)),
        "x": np.zeros(shape),
    }
    roads = jax.jit(jax.vmap(lambda count: road.straight_road(count, lanes_max=LANES)))(lanes)
    return Percept(
        **{name: value.astype(np.float32) for name, value in numbers.items()},
        lane=lane.astype(np.int32),
        road=jax.tree.map(lambda leaf: np.broadcast_to(leaf, (STEPS, *leaf.shape)), roads),
    )


@cache
def decisions(case):
    """What the JAX controller decides, shown the percepts one after the other."""
    trained = untrained(case)
    controller = recipe.evaluation_config(trained.settings, trained.name).controller
    seen = percepts(trained.settings.driving.observation.size)

    def decide(memory, percept):
        action, memory, traces = controllers.act(controller, trained.parameters, memory, percept)
        live = jnp.bool_(True)
        return memory, check.decision(controller, percept, action, memory, traces, live)

    def one(seen):
        first = jax.tree.map(lambda leaf: leaf[0], seen)
        return jax.lax.scan(decide, controller.start(first), seen)[1]

    return jax.device_get(jax.jit(jax.vmap(one, in_axes=1, out_axes=1))(seen))


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Both files of each case."""
    folder = tmp_path_factory.mktemp("policies")
    for case in CASES:
        for ending in ("npz", "onnx"):
            formats.save(contents.policy(untrained(case), "digest"), folder / f"{case}.{ending}")
    return folder


@pytest.mark.parametrize("ending", ["npz", "onnx"])
@pytest.mark.parametrize("case", CASES)
def test_decides_as_the_controller(files, case, ending):
    found = check.compare(formats.read(files / f"{case}.{ending}").step, decisions(case))
    assert found.states == found.same == STEPS * BATCH
    assert found.largest_difference < 1e-5
    assert len(found.actions) > 3


def test_one_car_and_a_batch_decide_alike(files):
    seen = decisions("hierarchical")
    batch, single = load(files / "hierarchical.npz"), load(files / "hierarchical.npz")
    for number in range(STEPS):
        ego = Ego(*(value[number] for value in seen.ego))
        actions = batch.act(seen.features[number], ego)
        assert np.array_equal(actions, seen.action[number])
        alone = single.act(seen.features[number, 7], Ego(*(value[7] for value in ego)))
        assert type(alone) is int
        assert alone == actions[7]


@pytest.mark.parametrize("case", ["hierarchical", "single-level, held"])
def test_some_episodes_begin_anew(files, case):
    seen = decisions(case)
    policy, fresh = load(files / f"{case}.npz"), load(files / f"{case}.npz")
    first = (seen.features[0], Ego(*(value[0] for value in seen.ego)))
    second = (seen.features[1], Ego(*(value[1] for value in seen.ego)))
    begun = policy.act(*first)
    which = np.arange(BATCH) % 2 == 0
    policy.reset(which)
    assert np.array_equal(policy.act(*second)[which], fresh.act(*second)[which])
    policy.reset()
    assert np.array_equal(policy.act(*first), begun)


def test_the_reader_needs_numpy_alone(files, tmp_path):
    shutil.copy(numpy_policy.__file__, tmp_path / "numpy_policy.py")
    program = (
        "import sys; sys.path.insert(0, sys.argv[1])\n"
        "import numpy_policy as p\n"
        "policy = p.load(sys.argv[2])\n"
        "ego = p.Ego(y=4.0, heading=0.0, speed=10.0, lane_centres=[0.0, 4.0, 8.0])\n"
        "print(policy.act([0.1] * 26, ego))\n"
        "assert not {'jax', 'lanewise', 'onnx', 'safetensors'} & set(sys.modules)\n"
    )
    words = [sys.executable, "-I", "-c", program, str(tmp_path), str(files / "planned.npz")]
    said = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    assert int(said) == load(files / "planned.npz").act([0.1] * 26, EGO)


def test_says_what_it_is(files):
    about = load(files / "planned.npz").about
    assert (about["controller"], about["settings_digest"]) == ("planned", "digest")
    assert about["goals"]["lifetime"] == 3
    assert about["observation"]["scaling"] == "fine"
    model = onnx.load(files / "planned.onnx")
    assert (model.producer_name, model.ir_version) == ("lanewise", onnx_model.IR_VERSION)
    assert [(each.domain, each.version) for each in model.opset_import] == [("", onnx_model.OPSET)]
    props = {each.key: each.value for each in model.metadata_props}
    assert (props["controller"], props["settings_digest"]) == ("planned", "digest")
    assert json.loads(props["about"]) == about


def test_an_onnx_model_has_the_inputs_and_outputs_of_its_kind(files):
    graph = onnx.load(files / "hierarchical.onnx").graph
    memory = ["begins", "goal_lane", "goal_speed", "age"]
    assert [each.name for each in graph.input] == ["features", *Ego._fields, *memory]
    values = ["high_level_values", "low_level_values"]
    outputs = ["action", *(f"next_{name}" for name in memory), *values]
    assert [each.name for each in graph.output] == outputs
    assert all(each.doc_string for each in (*graph.input, *graph.output))
    graph = onnx.load(files / "single-level.onnx").graph
    assert [each.name for each in graph.input] == ["features"]
    assert [each.name for each in graph.output] == ["action", "single_level_values"]


def test_another_runtime_computes_the_same(files):
    policy, seen = load(files / "planned.npz"), decisions("planned")
    ego = {name: part[0] for name, part in seen.ego._asdict().items()}
    reference = ReferenceEvaluator(str(files / "planned.onnx"))
    inputs = {"features": seen.features[0]} | ego | policy.start(BATCH)
    assert np.array_equal(reference.run(None, inputs)[0], seen.action[0])


def test_files_are_the_same_bytes_each_time(files, tmp_path):
    for ending in ("onnx", "npz"):
        path = tmp_path / f"planned.{ending}"
        formats.save(contents.policy(untrained("planned"), "digest"), path)
        assert path.read_bytes() == (files / path.name).read_bytes()


def test_what_cannot_be_recorded_is_refused():
    value = Value(Graph(), "features", np.float32)
    for function in (np.tan, np.cumsum):
        with pytest.raises(TypeError):
            function(value)


@pytest.mark.parametrize(
    ("features", "ego", "says"),
    [
        ([0.0] * 26, None, "needs the ego"),
        ([0.0] * 25, EGO, "features must be"),
        ([np.nan] * 26, EGO, "features must be"),
        ([0.0] * 26, EGO._replace(speed=np.nan), "must be finite"),
        ([0.0] * 26, EGO._replace(lane_centres=[np.inf]), "must have a lane"),
    ],
)
def test_wrong_inputs_are_refused(files, features, ego, says):
    policy = load(files / "hierarchical.npz")
    with pytest.raises(ValueError, match=says):
        policy.act(features, ego)
    policy.reset()
    policy.act(np.zeros((2, 26)), EGO)
    with pytest.raises(ValueError, match="another size"):
        policy.act(np.zeros((3, 26)), EGO)


@pytest.mark.parametrize(
    ("place", "change", "says"),
    [
        ("about", None, "is no .*lacks 'about'"),
        ("about", "no JSON", "is no .*Expecting value"),
        ("about", '{"format": "lanewise-policy", "version": 3}', "has .* version 3, written"),
        ("low_level/0/weights", None, "is no .*lacks 'low_level/0/weights'"),
        ("low_level/0/weights", np.zeros((27, 32), np.float32), "is no .*mismatch"),
        ("low_level/0/biases", np.array([{}], object), "is no .*Object arrays"),
    ],
)
def test_an_altered_file_is_refused(files, tmp_path, place, change, says):
    path = tmp_path / "altered.npz"
    with np.load(files / "hierarchical.npz") as file:
        arrays = dict(file) | {place: change}
    np.savez(path, **{name: array for name, array in arrays.items() if array is not None})
    with pytest.raises(numpy_policy.PolicyError, match=rf"altered\.npz {says}"):
        load(path)


def test_other_files_are_refused(files, tmp_path, monkeypatch):
    path = tmp_path / "other.npz"
    for data in (b"", b"text", (files / "planned.npz").read_bytes()[:-200]):
        path.write_bytes(data)
        with pytest.raises(ValueError, match="is no policy"):
            load(path)
    np.savez_compressed(path, zeros=np.zeros(10_000_000))
    with pytest.raises(ValueError, match="is compressed"):
        load(path)
    with ZipFile(path, "w") as archive:
        archive.writestr("zeros.npy", bytes(1000))
        archive.filelist *= 2  # Two names for the same bytes.
    with pytest.raises(ValueError, match="larger than the file"):
        load(path)
    monkeypatch.setattr(numpy_policy, "LARGEST", 1000)
    with pytest.raises(ValueError, match="of at most 1000 bytes"):
        load(files / "planned.npz")


def test_a_wrong_policy_is_noticed():
    seen = decisions("single-level")
    policy = contents.policy(untrained("single-level"), "")
    policy.arrays["single_level/1/biases"] = policy.arrays["single_level/1/biases"][::-1]
    found = check.compare(policy.step, seen)
    assert found.different > 50
    assert found.same + found.tied + found.different == found.states


def test_ties_are_counted_apart():
    seen = decisions("single-level")
    second = np.argsort(-seen.values["single_level"], axis=-1)[..., 1]
    best = np.take_along_axis(seen.values["single_level"], seen.action[..., None], -1)
    tied = seen.values["single_level"].copy()
    np.put_along_axis(tied, second[..., None], best - 1e-5, -1)
    numbers = iter(range(STEPS))

    def other(features, ego, memory):
        chosen = second[next(numbers)]
        return chosen, memory, {"single_level": np.eye(9)[chosen]}

    found = check.compare(other, replace(seen, values={"single_level": tied}))
    assert (found.same, found.tied, found.different) == (0, found.states, 0)
