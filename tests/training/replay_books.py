"""What a training stage writes to its replays, booked once more in plain Python.

A controller is wrapped so that its memory notes what every level saw and chose and what its goal
came to; episodes, pay, discounts and next features are then worked out from these notes by hand.
"""

from contextlib import contextmanager
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lanewise.driving import episode, percept
from lanewise.driving.episode import EpisodeStats
from lanewise.driving.task_functions import PAPER_TASK
from lanewise.training import rollout, stage


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Noted:
    """A controller's own memory, and what was noted of the decision."""

    own: Any
    notes: dict[str, Any]


@dataclass(frozen=True)
class NotedLevel:
    """A level that notes when it chooses, what it sees, what it chooses."""

    level: Any
    below: tuple = ()
    """Levels below it, whose view its choice changes."""

    name = property(lambda self: self.level.name)
    feature_count = property(lambda self: self.level.feature_count)
    choice_count = property(lambda self: self.level.choice_count)

    def ready(self, memory):
        return self.level.ready(memory.own)

    def features(self, memory, percept):
        return self.level.features(memory.own, percept)

    def choose(self, memory, percept, choice):
        notes = dict(memory.notes)
        notes[f"{self.name} ready"] = self.level.ready(memory.own)
        notes[f"{self.name} saw"] = self.level.features(memory.own, percept)
        notes[f"{self.name} chose"] = jnp.int32(choice)
        own = self.level.choose(memory.own, percept, choice)
        for level in self.below:
            notes[f"{level.name} settled"] = level.features(own, percept)
        return Noted(own, notes)


@dataclass(frozen=True)
class NotedController:
    """A controller that notes."""

    controller: Any

    name = property(lambda self: self.controller.name)

    @property
    def levels(self):
        every = self.controller.levels
        return tuple(NotedLevel(level, tuple(every[i + 1 :])) for i, level in enumerate(every))

    def start(self, percept):
        own = self.controller.start(percept)
        notes = {"before": jnp.float32(0.0), "after": jnp.float32(0.0), "reached": jnp.bool_(False)}
        for level in self.levels:
            nothing = jnp.zeros(level.feature_count, jnp.float32)
            notes |= {f"{level.name} {what}": nothing for what in ("saw", "left", "settled")}
            notes[f"{level.name} ready"] = jnp.bool_(False)
            notes[f"{level.name} chose"] = jnp.int32(0)
        return Noted(own, notes)

    def act(self, memory, percept):
        before = self.controller.feedback(memory.own, percept).distance
        action, own = self.controller.act(memory.own, percept)
        return action, Noted(own, memory.notes | {"before": before})

    def perceive(self, memory, percept):
        feedback = self.controller.feedback(memory.own, percept)
        own = self.controller.perceive(memory.own, percept)
        notes = memory.notes | {"after": feedback.distance, "reached": feedback.reached}
        for level in self.levels:
            notes[f"{level.name} left"] = level.level.features(own, percept)
        return Noted(own, notes)

    def feedback(self, memory, percept):
        return self.controller.feedback(memory.own, percept)

    def goal(self, memory):
        return self.controller.goal(memory.own)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Seen(EpisodeStats):
    """Stats and notes."""

    notes: dict[str, Any]
    paid: Any
    """[] the decision's external reward."""


def noting(config):
    """The stage config with a controller that notes."""
    return replace(config, controller=NotedController(config.controller), task=TASK)


def drive(config, frozen, key, iterations):
    """The driving half of a stage: (its last state, the notes [iterations, worlds]).

    Compiled are only the parts that are the same for every controller (`uncompiled`).
    """
    state = stage.begin.__wrapped__.__wrapped__(config, frozen, key)
    seen = []
    for number in range(iterations):
        state, stats = stage._drive(config, frozen, state, jax.random.fold_in(key, number))
        facts = {name: getattr(stats, name) for name in EpisodeStats.__dataclass_fields__}
        notes = ENDED.pop().memory.notes
        seen.append(jax.device_get(Seen(**facts, notes=notes, paid=stats.outcome.reward)))
    return state, jax.tree.map(lambda *parts: np.stack(parts), *seen)


ENDED = []
"""The worlds after a decision, before those that are over begin anew."""
TASK = replace(PAPER_TASK, start=jax.jit(PAPER_TASK.start, static_argnums=(0, 2)))


@contextmanager
def uncompiled():
    """Within it a stage is driven operation by operation, but for the world in one program."""

    def restart(over, rollouts, begin):
        ENDED.append(rollouts)
        if not over.any():
            return rollouts
        return jax.tree.map(
            lambda new, old: jnp.where(over.reshape(-1, *(1,) * (new.ndim - 1)), new, old),
            begin(np.arange(len(over))),
            rollouts,
        )

    world = SimpleNamespace(
        begin=jax.jit(episode.begin), step=jax.jit(episode.step, static_argnums=(0, 4))
    )
    perceive = jax.jit(percept.perceive, static_argnums=(0, 2))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rollout, "episode", world)
        patch.setattr(rollout, "percept", SimpleNamespace(perceive=perceive))
        patch.setattr(stage.restarting, "restart_finished", restart)
        yield


def book(config, seen, name):
    """The rows of a level's replay, in the order in which they are written.

    Without those of the last iteration: whether a choice follows it is not noted.

    Args:
        config: of the stage.
        seen: [iterations, worlds] facts and notes.
        name: of the level.
    """
    level_settings = dict(config.learning)[name]
    written = []
    for world in range(seen.outcome.over.shape[1]):
        begins = 0
        for last in [*np.flatnonzero(seen.outcome.over[:, world]), len(seen.outcome.over) - 1]:
            if last >= begins:
                one = jax.tree.map(lambda leaf, w=world, b=begins, e=last: leaf[b : e + 1, w], seen)
                rows = _episode(level_settings, one, name, _view(config, name))
                written += [(begins + end, world, -start, row) for start, end, row in rows]
            begins = last + 1
    # By decision, then by world; of those complete at once the newest choice is first.
    written.sort(key=lambda entry: entry[:3])
    return np.array([row for end, *_, row in written if end < len(seen.outcome.over) - 1])


def _view(config, name):
    """What a level sees where a transition leads to: (in an episode that goes on, at its end).

    ``saw``, what it then chooses from; ``left``, the same with the goal it acted for, if any;
    ``settled``, with the goal that the frozen level above it has set by then.
    """
    learning = dict(config.learning)
    if name != "low_level":
        return "saw", "left"
    return ("left", "left") if "high_level" in learning else ("saw", "settled")


def _episode(level_settings, seen, name, view):
    """Of one episode, maybe cut short: (first decision, last decision, row) of each transition."""
    ready = np.flatnonzero(seen.notes[f"{name} ready"])
    over, length = bool(seen.outcome.over[-1]), len(seen.outcome.over)
    terminated = over and int(seen.outcome.accident[-1]) != 0
    gamma, found = level_settings.learner.discount, []
    for number, start in enumerate(ready):
        later = ready[number + 1 : number + 1 + level_settings.returns]
        if len(later) == level_settings.returns:
            stop = later[-1]
        elif over:
            stop = length
        else:
            continue
        last = stop - 1
        ended = over and stop == length
        lost = ended and (terminated or level_settings.time_out == "terminal")
        lost |= level_settings.goal_end == "terminal" and bool(seen.notes["reached"][last])
        reward = 0.0
        for at in range(start, stop):
            choices = int(np.sum((ready > start) & (ready <= at)))
            exponent = choices if level_settings.discount_across_goal == "per-goal" else at - start
            crash = terminated and at == length - 1
            reward += gamma**exponent * _pay(level_settings, seen, at, crash)
        steps = len([r for r in ready if start <= r < stop])
        exponent = steps if level_settings.discount_across_goal == "per-goal" else stop - start
        discount = 0.0 if lost else gamma**exponent
        row = [
            *seen.notes[f"{name} saw"][start],
            seen.notes[f"{name} chose"][start],
            reward,
            discount,
            *_next(seen, name, stop, view[int(ended)]),
        ]
        found.append((start, last, row))
    return found


def _pay(level_settings, seen, at, crash):
    """What a decision pays a level."""
    paid = level_settings.external_weight * float(seen.paid[at])
    if crash:
        return paid
    before, after = float(seen.notes["before"][at]), float(seen.notes["after"][at])
    paid += (
        level_settings.approach_weight * (before - after) - level_settings.tracking_weight * after
    )
    return paid + level_settings.goal_reward * bool(seen.notes["reached"][at])


def _next(seen, name, stop, what):
    """What the level sees where a transition leads to, never of a fresh episode."""
    return seen.notes[f"{name} {what}"][stop if what == "saw" else stop - 1]
