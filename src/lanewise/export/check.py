"""An exported policy beside the controller it comes from, decision by decision.

The controller drives; the exported policy is shown the same, carries its own memory, and must
choose the same. Where it does not, it is counted, and goes on with the controller's memory.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from lanewise.controllers.controller import Controller, Memory, Parameters, Trace
from lanewise.controllers.hierarchical import TwoLevelMemory
from lanewise.controllers.single_level import SingleLevel
from lanewise.driving.percept import Percept
from lanewise.evaluation import evaluator
from lanewise.evaluation.evaluator import Drive, EvaluationConfig
from lanewise.export.numpy_policy import START, Ego
from lanewise.runs.trained import Trained
from lanewise.system import pinned
from lanewise.training import recipe
from lanewise.world.state import World

TIE = 1e-4
"""Two Q-values nearer than this are within float32's rounding of each other."""

Step = Callable[[Any, Ego | None, Any], tuple[Any, Any, Any]]
"""As `numpy_policy.Policy.step`."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Decision:
    """One decision of the controller: what it saw, did and kept. [T, B] after a drive."""

    features: Any
    ego: Ego
    action: Any
    memory: dict[str, Any]
    """Afterwards, in the parts of an exported policy."""
    values: dict[str, Any]
    """Q-values by level."""
    ready: dict[str, Any]
    """By level, whether its choice counted."""
    live: Any
    """Whether the episode was still under way."""


@dataclass(frozen=True)
class Agreement:
    """How often an exported policy decided as its controller did."""

    states: int = 0
    """Decisions compared."""
    same: int = 0
    """With the same action and the same memory afterwards."""
    tied: int = 0
    """Others, where the two best Q-values differ by less than `TIE`."""
    different: int = 0
    """All others."""
    largest_difference: float = 0.0
    """Between two Q-values that should be equal."""
    actions: frozenset[int] = frozenset()
    """Those that were chosen."""

    def __add__(self, other: "Agreement") -> "Agreement":
        """Of both together."""
        return Agreement(
            self.states + other.states,
            self.same + other.same,
            self.tied + other.tied,
            self.different + other.different,
            max(self.largest_difference, other.largest_difference),
            self.actions | other.actions,
        )

    def to_json(self) -> dict[str, Any]:
        """As plain data."""
        return asdict(self) | {"actions": sorted(self.actions)}

    def __str__(self) -> str:
        """One line."""
        return (
            f"{self.states} decisions: {self.same} the same, {self.tied} tied, "
            f"{self.different} different; Q-values differ by {self.largest_difference:.1e} at most"
        )


def agreement(
    trained: Trained,
    step: Step,
    states: int,
    seed: int = 0,
    renewal: str | None = None,
    done: Callable[[int], None] = lambda count: None,
    split: str = "training",
) -> Agreement:
    """Compare an exported policy with its controller, which drives from starts of a split.

    At least so many ``states`` are compared. Goals are renewed as it was exported, and ``done`` is
    called with how many are done.
    """
    config = recipe.evaluation_config(trained.settings, trained.name, renewal)
    config = replace(config, split=split)
    total, first = Agreement(), 0
    while total.states < states:
        worlds = evaluator.start_block(config, seed, first)
        total += compare(step, jax.device_get(_drive(config, trained.parameters, worlds)))
        done(min(total.states, states))
        first += evaluator.BLOCK
    return total


@pinned.jit(static_argnums=0)
def _drive(config: EvaluationConfig, parameters: Parameters, worlds: World) -> Decision:
    """The greedy controller's decisions from a block of starts, [T, B]."""

    def decide(drive: Drive, _: None) -> tuple[Drive, Decision]:
        action, memory, traces = evaluator.act(config, parameters, drive)
        live = ~drive.episode.outcome.over
        made = decision(config.controller, drive.percept, action, memory, traces, live)
        return evaluator.step(config, drive, memory, action), made

    def one(world: World) -> Decision:
        begun = evaluator.begin(config, world)
        made: Decision = jax.lax.scan(decide, begun, length=config.duration)[1]
        return made

    along_time: Decision = jax.vmap(one, out_axes=1)(worlds)
    return along_time


def decision(
    controller: Controller,
    seen: Percept,
    action: Array,
    memory: Memory,
    traces: dict[str, Trace],
    live: Array,
) -> Decision:
    """What there is to compare; lanes that are absent have infinite centres."""
    centres = jnp.where(seen.road.present, seen.road.centre, jnp.inf)
    return Decision(
        features=seen.features,
        ego=Ego(seen.y, seen.heading, seen.speed, centres),
        action=action,
        memory=_exported(controller, memory),
        values={name: trace.values for name, trace in traces.items()},
        ready={name: trace.ready for name, trace in traces.items()},
        live=live,
    )


def _exported(controller: Controller, memory: Memory) -> dict[str, Array]:
    """A controller's memory in the parts of an exported policy's."""
    if isinstance(memory, TwoLevelMemory):
        begins, goal, age = memory.goal.due, memory.goal.goal, memory.goal.age
        return {"begins": begins, "goal_lane": goal.lane, "goal_speed": goal.speed, "age": age}
    if isinstance(controller, SingleLevel) and controller.hold == 1:
        return {}
    return {"held": memory.action, "age": memory.age}


def compare(step: Step, decisions: Decision) -> Agreement:
    """Show an exported policy what the controller saw, [T, B]."""
    length, batch = decisions.action.shape
    start = next(part for part in START.values() if part.keys() == decisions.memory.keys())
    memory = {name: np.full(batch, value, value.dtype) for name, value in start.items()}
    same, values = [], []
    for number in range(length):
        made: Decision = jax.tree.map(lambda leaf, n=number: leaf[n], decisions)
        action, after, found = step(made.features, made.ego if "begins" in start else None, memory)
        agreed = np.asarray(action == made.action)
        for name, part in after.items():
            agreed &= np.abs(part.astype(np.float64) - made.memory[name]) < TIE
        memory = {
            name: np.where(agreed, part, made.memory[name]).astype(part.dtype)
            for name, part in after.items()
        }
        same.append(agreed)
        values.append(found)
    return _counted(decisions, np.stack(same), jax.tree.map(lambda *v: np.stack(v), *values))


def _counted(made: Decision, same: NDArray[np.bool_], values: Any) -> Agreement:
    """How often action and memory were the `same`, [T, B], and why they were not."""
    tied = np.zeros_like(same)
    for name, ours in reversed(made.values.items()):
        other = values[name].argmax(-1)
        gap = ours.max(-1) - np.take_along_axis(ours, other[..., None], -1)[..., 0]
        # The level that chose first explains what follows from it.
        tied = np.where(made.ready[name] & (ours.argmax(-1) != other), gap < TIE, tied)
    agreed, missed = made.live & same, made.live & ~same
    off = (np.abs(values[name] - ours)[agreed] for name, ours in made.values.items())
    return Agreement(
        states=int(made.live.sum()),
        same=int(agreed.sum()),
        tied=int((missed & tied).sum()),
        different=int((missed & ~tied).sum()),
        largest_difference=max(float(each.max(initial=0.0)) for each in off),
        actions=frozenset(made.action[made.live].tolist()),
    )
