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
import re
import stat
import struct
from io import BytesIO
from typing import Any, NamedTuple
from zipfile import ZIP_STORED, BadZipFile, ZipFile

import numpy as np

FORMAT, VERSION = "lanewise-policy", 1
FEATURE_COUNT = 26
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

LARGEST, MOST_ARRAYS, ACTIONS, SIGNS = 64_000_000, 500, 9, (-1.0, 0.0, 1.0)
"""Bytes of a file and arrays in it, at most; low-level actions; signs."""
HEADER = re.compile(
    rb"\x93NUMPY\x01\x00..\{'descr': '(<f4|<i8|<U[0-9]{1,7})', 'fortran_order': (True|False), "
    rb"'shape': \(((?:[0-9]{1,9}(?:, ?)?){0,4})\), \} *\n",
    re.DOTALL,
)
"""How an array's bytes begin, as NumPy writes them."""
COMMON = {"seed": (0, 2**31 - 1), "decision_frequency": (1, 50)}
GOALS = {
    "lowest_speed": (0.0, 40.0),
    "highest_speed": (0.0, 40.0),
    "speed_step": (0.05, 10.0),
    "lateral_tolerance": (0.01, 4.0),
    "speed_tolerance": (0.01, 10.0),
}
PLANNER = {
    "acceleration": (0.01, 10.0),
    "steering": (0.001, 1.0),
    "tick": (0.001, 1.0),
    "decision": (0.001, 1.0),
}
"""Numbers and the bounds that Lanewise's settings set them."""

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
        self._memory = {
            name: np.where(which, fresh[name], part) for name, part in self._memory.items()
        }

    def act(self, features: Array, ego: Ego | None = None) -> Array:
        """The next action; remembers what has to be remembered.

        Args:
            features: [26] as Lanewise's environments observe them, or [B, 26].
            ego: the car itself; needed by controllers with goals.

        Returns:
            3 (acceleration + 1) + (steering + 1) with signs -1, 0, 1: a number, or int64 [B].

        Raises:
            ValueError: an input is missing, is not finite, or has another shape.
        """
        rows = np.atleast_2d(np.asarray(features, np.float32))
        batch = len(rows)
        if rows.shape != (batch, FEATURE_COUNT) or not np.isfinite(rows).all():
            raise ValueError(f"features must be [26] or [B, 26] finite numbers, got {rows.shape}")
        if self._memory is None:
            self._memory = self.start(batch)
        if any(len(part) != batch for part in self._memory.values()):
            raise ValueError("the batch has another size than before: call reset() first")
        seen = self._checked(ego, batch) if self.has_goals else None
        action, self._memory, _ = self.step(rows, seen, self._memory)
        return int(action[0]) if np.ndim(features) == 1 else action

    def step(
        self, features: Array, ego: Ego | None, memory: Memory
    ) -> tuple[Array, Memory, dict[str, Array]]:
        """One decision of a batch, without checks or side effects.

        Args:
            features: float32 [B, 26].
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
            values["low_level"] = self._values(
                "low_level", np.concatenate([features, goal], axis=1)
            )
            action = np.argmax(values["low_level"], axis=1)
        return action, memory | {"age": memory["age"] + 1}, values

    def _checked(self, ego: Ego | None, batch: int) -> Ego:
        """The ego as float32 arrays of a batch."""
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
            if layer:
                features = np.maximum(features, 0.0)
            weights, biases = (self.arrays[f"{level}/{layer}/{n}"] for n in ("weights", "biases"))
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
    """A file is no policy, or a damaged or altered one."""


def load(path: str | os.PathLike[str]) -> Policy:
    """Read a policy; nothing in the file can run, and no more of it is read than its own length.

    Raises:
        OSError: the file cannot be read.
        PolicyError: it is no policy, or one of another version; a ValueError.
    """
    if not stat.S_ISREG(os.stat(path).st_mode):
        raise PolicyError(f"{path} is no policy of Lanewise: it is not a regular file")
    with open(path, "rb") as file:
        data = file.read(LARGEST + 1)
    try:
        members = _members(data)
        # First of all: arrays of another version may be of types that are not known here.
        about = _about(_array(members.pop("about")))
        ours = about["format"] == FORMAT and about["version"] == VERSION
        arrays = {name: _array(member) for name, member in members.items()} if ours else {}
        if ours:
            _check(about, arrays)
    except _DAMAGE as error:
        reason = f"it lacks {error}" if isinstance(error, KeyError) else str(error)
        raise PolicyError(
            f"{path} is no policy of Lanewise, or a damaged one: {ascii(reason)[1:-1][:120]}"
        ) from error
    if not ours:
        found = [str(about.get(name, "unknown")) for name in ("format", "version", "lanewise")]
        told = "{} version {}, written by lanewise {}".format(*(ascii(t)[1:-1][:80] for t in found))
        raise PolicyError(
            f"{path} has format {told}; this reader knows {FORMAT} version {VERSION}: "
            "use the one of the lanewise that wrote it, or a newer one"
        )
    return Policy(about, arrays)


_DAMAGE = (
    *(KeyError, AttributeError, TypeError, ValueError, IndexError, OverflowError, EOFError),
    *(BadZipFile, NotImplementedError, RuntimeError, OSError, struct.error),
)
"""What reading a file that is not what it should be can raise; RecursionError is among them."""


def _members(data: bytes) -> dict[str, bytes]:
    """The arrays of an archive that NumPy's `savez` wrote, uncompressed and each as its bytes.

    Raises:
        ValueError: it is too large, compressed, or says that it holds more than it does.
    """
    if len(data) > LARGEST:
        raise ValueError(f"it is larger than {LARGEST} bytes")
    # One of these begins each entry of the list of members.
    if data.count(b"PK\x01\x02") > MOST_ARRAYS:
        raise ValueError(f"it holds more than {MOST_ARRAYS} arrays")
    found: dict[str, bytes] = {}
    with ZipFile(BytesIO(data)) as archive:
        members = archive.infolist()
        if sum(member.file_size for member in members) > len(data):
            raise ValueError("it says that it holds more than it does")
        for member in members:
            name = member.filename.removesuffix(".npy")
            if member.compress_type != ZIP_STORED or name in found:
                raise ValueError("it is compressed, or holds an array twice")
            found[name] = archive.read(member)
    return found


def _array(data: bytes) -> Array:
    """An array out of the bytes that NumPy's `save` wrote for one of our types.

    Raises:
        ValueError: they are something else.
    """
    header = HEADER.match(data)
    if header is None or header.end() != 10 + int.from_bytes(data[8:10], "little"):
        raise ValueError("an array's header is not as NumPy writes it")
    kind, fortran, sizes = (part.decode("ascii") for part in header.groups())
    shape = tuple(int(size) for size in sizes.replace(",", " ").split())
    dtype = np.dtype(kind)
    if math.prod(shape) * dtype.itemsize != len(data) - header.end():
        raise ValueError("an array's shape does not fit its length")
    flat = np.frombuffer(data, dtype, offset=header.end())
    return flat.reshape(shape, order="F" if fortran == "True" else "C")


def _about(text: Array) -> dict[str, Any]:
    """What the policy says of itself.

    Raises:
        ValueError: it is no JSON object in a text.
    """
    if text.dtype.kind != "U" or text.shape:
        raise ValueError("what it says of itself is no text")
    about = json.loads(text.tobytes().decode("utf-32-le"), parse_constant=_refused)
    if not isinstance(about, dict):
        raise ValueError("what it says of itself is no object")
    return about


def _refused(word: str) -> None:
    raise ValueError(f"{word} is no number")


def _check(about: dict[str, Any], arrays: dict[str, Array]) -> None:
    """Raises ValueError, TypeError or KeyError unless all is there that a decision needs."""
    memory, planned = about["memory"], "planner" in about
    if memory not in START:
        raise ValueError("the memory is none that is known")
    for name, (low, high) in COMMON.items():
        _number(about, name, low, high)
    for name in ("controller", "settings_digest", "lanewise"):
        if not isinstance(about[name], str):
            raise ValueError(f"{name} is no text")
    moves = _check_goals(about["goals"]) if memory == "goal" else ACTIONS
    if memory == "held-action":
        _number(about, "hold", 1, 1000, int)
    choices = {"single_level": ACTIONS} if memory != "goal" else {"high_level": moves}
    if memory == "goal" and not planned:
        choices["low_level"] = ACTIONS
    if about["levels"].keys() != choices.keys():
        raise ValueError("its levels are not those of its kind")
    known = set(_check_planner(about["planner"], arrays) if planned else ())
    for level, count in choices.items():
        known |= _check_network(arrays, level, _number(about["levels"], level, 1, 64, int), count)
    if arrays.keys() != known:
        raise ValueError("it holds arrays that do not belong there")


def _check_goals(goals: dict[str, Any]) -> int:
    """How many moves of a goal there are; raises ValueError if something is wrong with one."""
    for name, (low, high) in GOALS.items():
        _number(goals, name, low, high)
    _number(goals, "lifetime", 1, 10_000_000, int)
    if goals["reference"] not in ("previous-goal", "current-state"):
        raise ValueError("reference is none that is known")
    if goals["lowest_speed"] > goals["highest_speed"]:
        raise ValueError("the lowest speed of goals exceeds the highest")
    moves = goals["moves"]
    if not isinstance(moves, list) or not 1 <= len(moves) <= MOST_ARRAYS:
        raise ValueError("moves are no list")
    if any(len(move) != 2 or not {*move} <= {-1, 0, 1} for move in moves):
        raise ValueError("a move is none")
    return len(moves)


def _check_planner(planner: dict[str, Any], arrays: dict[str, Array]) -> list[str]:
    """Names of the planner's arrays; raises ValueError if something is wrong with one."""
    for name, (low, high) in PLANNER.items():
        _number(planner, name, low, high)
    _number(planner, "ticks", 1, 1000, int)
    names = [f"planner/{name}" for name in ("turns", "trims", "trim_steps")]
    turns, trims, steps = (arrays[name] for name in names)
    if turns.ndim != 2 or not len(turns) or not turns.shape[:1] == trims.shape == steps.shape:
        raise ValueError("the planner's candidates do not fit")
    if (turns.dtype, trims.dtype, steps.dtype) != (np.float32, np.float32, np.int64):
        raise ValueError("the planner's candidates are of another type")
    if not turns.shape[1] or not (np.isin(turns, SIGNS).all() and np.isin(trims, SIGNS).all()):
        raise ValueError("the planner's candidates are no signs")
    if steps.min() < 0 or steps.max() >= turns.shape[1]:
        raise ValueError("the planner's candidates are trimmed at no step")
    return names


def _check_network(arrays: dict[str, Array], level: str, layers: int, choices: int) -> set[str]:
    """Names of a level's arrays; raises ValueError or KeyError unless they fit and are finite."""
    width, names = FEATURE_COUNT + 2 * (level == "low_level"), set()
    for layer in range(layers):
        own = [f"{level}/{layer}/{name}" for name in ("weights", "biases")]
        weights, biases = (arrays[name] for name in own)
        if biases.ndim != 1 or weights.shape != (width, len(biases)):
            raise ValueError(f"{level}: layer {layer} does not fit")
        if not weights.dtype == biases.dtype == np.float32:
            raise ValueError(f"{level}: layer {layer} is of another type")
        if not np.isfinite(weights).all() or not np.isfinite(biases).all():
            raise ValueError(f"{level}: layer {layer} is not finite")
        names.update(own)
        width = len(biases)
    if width != choices:
        raise ValueError(f"{level}: chooses among {width}, not {choices}")
    return names


def _number(table: dict[str, Any], name: str, low: float, high: float, kind: Any = None) -> Any:
    """A number of a table; raises ValueError unless it is one between two bounds."""
    value = table[name]
    if type(value) not in ((kind,) if kind else (int, float)) or not low <= value <= high:
        raise ValueError(f"{name} is no number from {low:g} to {high:g}")
    return value
