"""A controller of Lanewise without JAX and without Lanewise: this file needs NumPy alone.

Copy it beside a file written by ``lanewise export RUN --out policy.npz``, then::

    from numpy_policy import Ego, load

    policy = load("policy.npz")
    policy.reset()  # at the start of every episode
    ego = Ego(y=4.0, heading=0.0, speed=10.0, lane_centres=[0.0, 4.0, 8.0])
    action = policy.act(features, ego)  # once a decision: 0 to 8

`Policy.step` is the same as a pure function of a batch. It is written in NumPy functions that
dispatch on their arguments, so that the ONNX model is recorded from it (`onnx_model`).
"""

import json
import math
import os
import stat
from io import BytesIO
from typing import Any, NamedTuple
from zipfile import ZIP_STORED, ZipFile

import numpy as np
from numpy.lib.format import read_array

FORMAT, VERSION = "lanewise-policy", 2
START: dict[str, dict[str, Any]] = {
    "none": {},
    "held-action": {"held": np.int64(0), "age": np.int64(0)},
    "goal": {
        "begins": np.True_,
        "goal_lane": np.int64(0),
        "goal_speed": np.float32(0.0),
        "age": np.int64(0),
    },
}
"""By kind of memory, its parts and what they are before an episode's first decision."""
Array = Any
Memory = dict[str, Array]

LARGEST = 64_000_000
"""Bytes of a file, at most."""

VARIANCE_FLOOR = 1e-5
LATERAL_RANGE, SPEED_RANGE, GOAL_LIMIT = 4.0, 2.0, 2.0
HALF_LENGTH, STRAIGHT, HEADING_LIMIT = 2.5, 0.004, 0.2
LOOK_AHEAD, SPEED_FIRST, REST = 1.0, 1.5, 0.28


class Ego(NamedTuple):
    """The car itself, in SI units; each a number, or an array [B] for a batch."""

    y: Array
    """m across the road, positive to the right."""
    heading: Array
    """rad from the road's direction, positive to the right."""
    speed: Array
    """m/s along the heading."""
    lane_centres: Array
    """[M], or [B, M]: y of each lane's centre, m, from left to right; infinity fills up where a
    batch's roads have different numbers of lanes."""


class Policy:
    """A controller that acts greedily; made by `load`."""

    def __init__(self, about: dict[str, Any], arrays: dict[str, Array]) -> None:
        self.about = about
        """What it is and the settings it needs; see docs/usage.md."""
        self.arrays = arrays
        """Weights by ``LEVEL/LAYER/weights`` and ``…/biases``, and the planner's candidates."""
        self._memory: Memory | None = None

    @property
    def has_goals(self) -> bool:
        """Whether it sets goals, and so needs the ego in SI units."""
        return bool(self.about["memory"] == "goal")

    @property
    def feature_count(self) -> int:
        """Number F of features that it observes."""
        first = "high_level" if self.has_goals else "single_level"
        return int(self.arrays[f"{first}/0/weights"].shape[0])

    def start(self, batch: int) -> Memory:
        """The memory before the first decision, each part [batch]."""
        parts = START[self.about["memory"]]
        return {name: np.full(batch, value, value.dtype) for name, value in parts.items()}

    def reset(self, which: Array = None) -> None:
        """A new episode: of all, or of those in a batch that ``which``, bool [B], marks."""
        if which is None or self._memory is None:
            self._memory = None
            return
        fresh = self.start(len(which))
        self._memory = {n: np.where(which, fresh[n], part) for n, part in self._memory.items()}

    def act(self, features: Array, ego: Ego | None = None) -> Array:
        """The next action; remembers what has to be remembered.

        Args:
            features: [F] as Lanewise's environments observe them, or [B, F].
            ego: the car itself; needed by controllers with goals.

        Returns:
            3 (acceleration + 1) + (steering + 1) with signs -1, 0, 1: a number, or int64 [B].

        Raises:
            ValueError: an input is missing, is not finite, or has another shape.
        """
        rows = np.atleast_2d(np.asarray(features, np.float32))
        batch = len(rows)
        count = self.feature_count
        if rows.shape != (batch, count) or not np.isfinite(rows).all():
            wanted = f"[{count}] or [B, {count}] finite numbers"
            raise ValueError(f"features must be {wanted}, got {rows.shape}")
        memory = self.start(batch) if self._memory is None else self._memory
        if any(len(part) != batch for part in memory.values()):
            raise ValueError("the batch has another size than before: call reset() first")
        seen = self._checked(ego, batch) if self.has_goals else None
        action, self._memory, _ = self.step(rows, seen, memory)
        return int(action[0]) if np.ndim(features) == 1 else action

    def step(
        self, features: Array, ego: Ego | None, memory: Memory
    ) -> tuple[Array, Memory, dict[str, Array]]:
        """One decision of a batch, without checks or side effects.

        Args:
            features: float32 [B, F].
            ego: float32 [B] and [B, M]; None for a controller without goals.
            memory: as from `start` or the last step.

        Returns:
            (int64 [B] action, the memory afterwards, Q-values [B, choices] by level).
        """
        if ego is None:
            return self._flat(features, memory)
        memory, values = self._with_goal(features, ego, memory)
        lateral, speed = self._errors(ego, memory)
        if "planner" in self.about:
            action = self._planned(ego, memory["goal_speed"], -lateral)
        else:
            scaled = np.stack([lateral / LATERAL_RANGE, speed / SPEED_RANGE], axis=1)
            goal = np.minimum(np.maximum(scaled, -GOAL_LIMIT), GOAL_LIMIT)
            seen = np.concatenate([features, goal], axis=1)
            values["low_level"] = self._values("low_level", seen)
            action = np.argmax(values["low_level"], axis=1)
        return action, memory | {"age": memory["age"] + 1}, values

    def _checked(self, ego: Ego | None, batch: int) -> Ego:
        if ego is None:
            raise ValueError("this controller sets goals: act(features, Ego(...)) needs the ego")
        y, heading, speed = (
            np.broadcast_to(np.asarray(value, np.float32), (batch,)) for value in ego[:3]
        )
        centres = np.asarray(ego.lane_centres, np.float32)
        centres = np.broadcast_to(centres, (batch, centres.shape[-1]))
        if not np.isfinite([y, heading, speed]).all() or not np.isfinite(centres[:, 0]).all():
            raise ValueError("the ego's numbers must be finite, and its road must have a lane")
        return Ego(y, heading, speed, centres)

    def _values(self, level: str, features: Array) -> Array:
        """Q-values of a level's network: ReLU between the layers, none after the last."""
        for layer in range(self.about["levels"][level]):
            weights, biases = (self.arrays[f"{level}/{layer}/{n}"] for n in ("weights", "biases"))
            if layer:
                if self.about["layer_normalisation"][level]:
                    features = _normalised(features, len(weights))
                features = np.maximum(features, 0.0)
            features = features @ weights + biases
        return features

    def _flat(self, features: Array, memory: Memory) -> tuple[Array, Memory, dict[str, Array]]:
        """The single-level controller, which may hold its choice for some decisions."""
        values = self._values("single_level", features)
        choice = np.argmax(values, axis=1)
        if memory:
            choice = np.where(memory["age"] == 0, choice, memory["held"])
            age = memory["age"] + 1
            memory = {"held": choice, "age": np.where(age == self.about["hold"], 0, age)}
        return choice, memory, {"single_level": values}

    def _with_goal(
        self, features: Array, ego: Ego, memory: Memory
    ) -> tuple[Memory, dict[str, Array]]:
        """The goal critic looks at the goal; where it has ended, the high level sets another."""
        goals = self.about["goals"]
        lowest, highest = goals["lowest_speed"], goals["highest_speed"]
        distance = np.abs(np.expand_dims(ego.y, 1) - ego.lane_centres)
        lane = np.argmin(distance, axis=1)
        speed = np.minimum(np.maximum(ego.speed, lowest), highest)
        last_lane = np.sum(np.where(np.isinf(distance), 0, 1), axis=1) - 1
        # Before the first decision there is no goal; the first one moves the state of the moment.
        first = memory["begins"]
        under_way = {
            "goal_lane": np.where(first, lane, memory["goal_lane"]),
            "goal_speed": np.where(first, speed, memory["goal_speed"]),
        }
        lateral, short = self._errors(ego, under_way)
        reached = (np.abs(lateral) < goals["lateral_tolerance"]) & (
            np.abs(short) < goals["speed_tolerance"]
        )
        due = first | reached | (memory["age"] >= goals["lifetime"])

        values = self._values("high_level", features)
        choice = np.argmax(values, axis=1)
        moves = np.asarray(goals["moves"])
        if goals["reference"] == "previous-goal":
            lane, speed = under_way["goal_lane"], under_way["goal_speed"]
        lane = lane + np.take_along_axis(moves[:, 0], choice, axis=0)
        lane = np.minimum(np.maximum(lane, 0), last_lane)
        steps = moves[:, 1].astype(np.float32) * goals["speed_step"]
        speed = speed + np.take_along_axis(steps, choice, axis=0)
        speed = np.minimum(np.maximum(speed, lowest), highest)
        renewed = {
            "begins": np.zeros_like(first),
            "goal_lane": np.where(due, lane, under_way["goal_lane"]),
            "goal_speed": np.where(due, speed, under_way["goal_speed"]),
            "age": np.where(due, 0, memory["age"]),
        }
        return renewed, {"high_level": values}

    def _errors(self, ego: Ego, goal: Memory) -> tuple[Array, Array]:
        """(m from the ego to the target lane's centre, m/s from its speed to the target's)."""
        centre = _chosen(ego.lane_centres, goal["goal_lane"])
        return centre - ego.y, goal["goal_speed"] - ego.speed * np.cos(ego.heading)

    def _planned(self, ego: Ego, target: Array, offset: Array) -> Array:
        """The rule-based planner: the first action of the cheapest of all previewed sequences."""
        planner = self.about["planner"]
        turns, trims = self.arrays["planner/turns"], self.arrays["planner/trims"]
        trim_steps, trimmed = self.arrays["planner/trim_steps"], trims != 0
        quantum = planner["acceleration"] * planner["decision"]
        target, offset, heading, speed = (
            np.expand_dims(value, 1) for value in (target, offset, ego.heading, ego.speed)
        )
        # A change of lane waits for the target speed.
        waits = (np.abs(offset) > SPEED_FIRST) & (np.abs(heading) < STRAIGHT)
        waits = waits & (self._pull(target, speed, quantum) != 0)
        cost = 0.2 * np.abs(trims)
        pulls = []
        for step in range(turns.shape[1]):
            turn = turns[:, step]
            straight = (turn == 0) & (np.abs(heading) < STRAIGHT)
            held = trimmed & (trim_steps < step)
            pull = self._pull(target, speed, quantum)
            pull = np.where(trimmed & (trim_steps == step), trims, pull)
            pull = np.where(straight & ~held, pull, np.float32(0.0))
            pulls.append(pull)
            wanted = target + np.where(trim_steps <= step, trims * quantum, np.float32(0.0))
            offset, heading, speed = _preview(planner, offset, heading, speed, turn, pull)
            cost = cost + (
                0.3 * np.square(offset)
                + np.square(100.0 * np.maximum(np.abs(heading) - HEADING_LIMIT, 0.0))
                + 0.01 * np.abs(turn)
                + 0.1 * np.abs(speed - wanted)
            )
        final = offset + LOOK_AHEAD * speed * np.sin(heading)
        cost = cost + 10.0 * np.square(final) + 10.0 * np.maximum(np.abs(final) - REST, 0.0)
        cost = cost + 0.3 * np.square(30.0 * heading)
        cost = np.where(waits & ((turns[:, 0] != 0) | trimmed), np.float32(np.inf), cost)
        best = np.argmin(cost, axis=1)
        first = 3.0 * (pulls[0] + 1.0) + turns[:, 0] + 1.0
        return _chosen(first, best).astype(np.int64)

    def _pull(self, target: Array, speed: Array, quantum: float) -> Array:
        """Sign of the acceleration that brings the speed nearest to its target."""
        return np.minimum(np.maximum(np.rint((target - speed) / quantum), -1.0), 1.0)


def _normalised(outputs: Array, count: int) -> Array:
    """A layer's outputs, [B, count], less their mean, by their standard deviation."""
    apart = outputs - np.expand_dims(np.sum(outputs, axis=1), 1) / np.float32(count)
    variance = np.expand_dims(np.sum(np.square(apart), axis=1), 1) / np.float32(count)
    return apart / np.sqrt(variance + VARIANCE_FLOOR)


def _chosen(rows: Array, index: Array) -> Array:
    """One element of each row: rows [B, M], index [B]."""
    return np.squeeze(np.take_along_axis(rows, np.expand_dims(index, 1), axis=1), axis=1)


def _preview(
    planner: dict[str, Any], offset: Array, heading: Array, speed: Array, turn: Array, pull: Array
) -> tuple[Array, Array, Array]:
    """One decision of the bicycle model in closed form, up to the midpoint rule."""
    ticks, tick = planner["ticks"], planner["tick"]
    slip = math.atan(math.tan(planner["steering"]) / 2.0)
    rate = speed * math.sin(slip) / HALF_LENGTH * turn
    acceleration = pull * planner["acceleration"]
    distance = (speed + acceleration * tick * (ticks - 1) / 2.0) * tick * ticks
    course = heading + slip * turn + rate * tick * (ticks - 1) / 2.0
    return (
        offset + distance * np.sin(course),
        heading + rate * tick * ticks,
        speed + acceleration * tick * ticks,
    )


class PolicyError(ValueError):
    """A file is no policy, or a damaged one."""


def load(path: str | os.PathLike[str]) -> Policy:
    """Read a policy; nothing in the file can run, and it takes no more memory than its length.

    Raises:
        OSError: the file cannot be read.
        PolicyError: it is no policy, or one of another version; a ValueError.
    """
    status = os.stat(path)
    if not stat.S_ISREG(status.st_mode) or status.st_size > LARGEST:
        raise PolicyError(
            f"{path} is no policy of Lanewise: no regular file of at most {LARGEST} bytes"
        )
    with open(path, "rb") as file:
        data = file.read()
    try:
        with ZipFile(BytesIO(data)) as archive:
            members = archive.infolist()
            if any(each.compress_type != ZIP_STORED for each in members):
                raise ValueError("it is compressed")
            if sum(each.file_size for each in members) > len(data):
                raise ValueError("its arrays are larger than the file")
            # Each array is read to its end, and so compared with its checksum.
            arrays = {
                name.removesuffix(".npy"): read_array(BytesIO(archive.read(name)))
                for name in archive.namelist()
            }
        about = json.loads(str(arrays.pop("about")))
        known = (about["format"], about["version"]) == (FORMAT, VERSION)
        policy = Policy(about, arrays)
        if known:
            decide_once(policy)
    except Exception as error:  # a damaged file can raise nearly anything
        reason = f"it lacks {error}" if isinstance(error, KeyError) else str(error)
        raise PolicyError(
            f"{path} is no policy of Lanewise, or a damaged one: {ascii(reason)[1:-1][:120]}"
        ) from error
    if not known:
        told = (ascii(about.get(name))[:80] for name in ("format", "version", "lanewise"))
        raise PolicyError(
            "{} has format {} version {}, written by lanewise {}; ".format(path, *told)
            + f"this reader knows {FORMAT} version {VERSION}: use the one of that lanewise"
        )
    return policy


def decide_once(policy: Policy) -> None:
    """Decide for a car of zeros: raises an error unless all is there that a decision needs."""
    zero = np.zeros(1, np.float32)
    ego = Ego(zero, zero, zero, zero[None]) if policy.has_goals else None
    policy.step(np.zeros((1, policy.feature_count), np.float32), ego, policy.start(1))
