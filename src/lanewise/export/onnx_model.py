"""A policy as one ONNX model, recorded from its own NumPy arithmetic."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx import ModelProto, ValueInfoProto, helper

from lanewise.export.numpy_policy import START, Ego, Policy
from lanewise.export.onnx_session import FEATURES, NEXT, VALUES
from lanewise.export.recording import Graph, Value
from lanewise.report import output_files

OPSET, IR_VERSION = 18, 8
"""Of ONNX 1.13 (2022), which runtimes since then read."""
BATCH = "batch"
MEANINGS = {
    FEATURES: "the features of Lanewise's observation",
    "y": "m across the road, positive to the right",
    "heading": "rad from the road's direction, positive to the right",
    "speed": "m/s along the heading",
    "lane_centres": "y of each lane's centre, m, from left to right; +inf where there is none",
    "begins": "whether this is an episode's first decision: there is no goal yet",
    "goal_lane": "target lane, from 0, the leftmost",
    "goal_speed": "target speed, m/s",
    "held": "action being held",
    "age": "decisions since the last choice",
    "action": "3 (acceleration + 1) + (steering + 1), signs -1, 0, 1, positive to the right",
}


def model(policy: Policy) -> ModelProto:
    """The ONNX model of a policy, with the inputs and outputs of `Policy.step` (docs/usage.md)."""
    graph = Graph()
    names = [FEATURES, *(Ego._fields if policy.has_goals else ())]
    seen = {name: Value(graph, name, np.float32) for name in names}
    start = START[policy.about["memory"]]
    memory = {name: Value(graph, name, value.dtype) for name, value in start.items()}
    features, *ego = seen.values()
    action, after, values = policy.step(features, Ego(*ego) if ego else None, memory)

    outputs = {"action": action} | {NEXT + name: part for name, part in after.items()}
    outputs |= {level + VALUES: value for level, value in values.items()}
    for name, value in outputs.items():
        graph.add("Identity", [value.name], value.dtype, output=name)
    shapes: dict[str, list[Any]] = {
        level + VALUES: [BATCH, len(policy.arrays[f"{level}/{layers - 1}/biases"])]
        for level, layers in policy.about["levels"].items()
    }
    shapes |= {FEATURES: [BATCH, policy.feature_count], "lane_centres": [BATCH, "lanes"]}
    drawn = helper.make_graph(
        graph.nodes,
        policy.about["controller"],
        [_described(name, value, shapes) for name, value in (seen | memory).items()],
        [_described(name, value, shapes) for name, value in outputs.items()],
        graph.constants,
    )
    made = helper.make_model(
        drawn,
        producer_name="lanewise",
        producer_version=policy.about["lanewise"],
        opset_imports=[helper.make_opsetid("", OPSET)],
        ir_version=IR_VERSION,
    )
    told = {name: str(policy.about[name]) for name in ("controller", "seed", "settings_digest")}
    helper.set_model_props(made, told | {"about": json.dumps(policy.about)})
    return made


def save(policy: Policy, path: Path) -> None:
    """Write a policy's model, once the checker has passed it."""
    made = model(policy)
    onnx.checker.check_model(made, full_check=True)
    with output_files.replacing(path) as beside:
        beside.write_bytes(made.SerializeToString(deterministic=True))


def _described(name: str, value: Value, shapes: dict[str, list[Any]]) -> ValueInfoProto:
    """Type, shape and meaning of an input or output."""
    kind = helper.np_dtype_to_tensor_dtype(value.dtype)
    meaning = MEANINGS.get(name.removeprefix(NEXT), "Q-values of the level's choices")
    return helper.make_tensor_value_info(name, kind, shapes.get(name, [BATCH]), meaning)
