"""ONNX models against the JAX controller, and what they say of themselves."""

import json

import numpy as np
import onnx
import pytest
from onnx.reference import ReferenceEvaluator
from seen import BATCH, CASES, STEPS, decisions, untrained

from lanewise.export import check, contents, formats, onnx_model
from lanewise.export.recording import Graph, Value


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A model of each case."""
    folder = tmp_path_factory.mktemp("models")
    for case in CASES:
        formats.save(contents.policy(untrained(case), "digest"), folder / f"{case}.onnx")
    return folder


@pytest.mark.parametrize("case", CASES)
def test_decides_as_the_controller(files, case):
    found = check.compare(formats.step(files / f"{case}.onnx"), decisions(case))
    assert found.states == found.same == STEPS * BATCH
    assert found.largest_difference < 1e-5


def test_another_runtime_computes_the_same(files):
    policy = contents.policy(untrained("planned"), "")
    seen = decisions("planned")
    ego = seen.ego._asdict()
    inputs = {"features": seen.features[0]} | {name: part[0] for name, part in ego.items()}
    reference = ReferenceEvaluator(str(files / "planned.onnx"))
    action, *_ = reference.run(None, inputs | policy.start(BATCH))
    assert np.array_equal(action, seen.action[0])


def test_says_what_it_is(files):
    model = onnx.load(files / "hierarchical.onnx")
    assert (model.producer_name, model.ir_version) == ("lanewise", onnx_model.IR_VERSION)
    assert [(each.domain, each.version) for each in model.opset_import] == [("", onnx_model.OPSET)]
    props = {each.key: each.value for each in model.metadata_props}
    assert (props["controller"], props["settings_digest"]) == ("hierarchical", "digest")
    assert json.loads(props["about"])["goals"]["renewal"] == "timestep"
    inputs = [each.name for each in model.graph.input]
    outputs = [each.name for each in model.graph.output]
    memory = ["begins", "goal_lane", "goal_speed", "age"]
    assert inputs == ["features", "y", "heading", "speed", "lane_centres", *memory]
    assert outputs == [
        "action",
        *(f"next_{name}" for name in memory),
        "high_level_values",
        "low_level_values",
    ]
    assert all(each.doc_string for each in (*model.graph.input, *model.graph.output))


def test_a_flat_controller_needs_the_features_alone(files):
    model = onnx.load(files / "single-level.onnx")
    assert [each.name for each in model.graph.input] == ["features"]
    assert [each.name for each in model.graph.output] == ["action", "single_level_values"]


def test_files_are_the_same_bytes_each_time(files, tmp_path):
    for ending in ("onnx", "npz"):
        paths = [tmp_path / f"{name}.{ending}" for name in "ab"]
        for path in paths:
            formats.save(contents.policy(untrained("planned"), "digest"), path)
        assert paths[0].read_bytes() == paths[1].read_bytes()


def test_what_cannot_be_recorded_is_refused():
    value = Value(Graph(), "features", np.float32)
    for function in (np.tan, np.cumsum):
        with pytest.raises(TypeError):
            function(value)
