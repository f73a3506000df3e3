"""What a training stage writes to its replays, booked once more in plain Python.

What every level saw and chose, and what its goal came to, follows from the worlds before and after
each decision; episodes, rewards, discounts and next features are then worked out by hand.
"""

from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lanewise.controllers import controller as controllers
from lanewise.driving import episode, percept
from lanewise.driving.task_functions import PAPER_TASK
from lanewise.training import rollout, stage

TASK = replace(PAPER_TASK, start=jax.jit(PAPER_TASK.start, static_argnums=(0, 2)))
ENDED = []
"""The worlds after a decision, before those that are over begin anew."""


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

    compiled = partial(jax.jit, static_argnames="training")
    world = SimpleNamespace(
        begin=jax.jit(episode.begin), step=compiled(episode.step, static_argnums=(0, 4))
    )
    perceive = compiled(percept.perceive, static_argnums=(0, 2))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rollout, "episode", world)
        patch.setattr(rollout, "percept", SimpleNamespace(perceive=perceive))
        patch.setattr(stage.restarting, "restart_finished", restart)
        yield


def drive(config, frozen, key, iterations):
    """The driving half of a stage: (its last state, the `notes` [iterations, worlds] by name)."""
    config = replace(config, task=TASK)
    state, steps = stage.begin.__wrapped__.__wrapped__(config, frozen, key), []
    for number in range(iterations):
        before = state.rollouts
        state, _ = stage._drive(config, frozen, state, jax.random.fold_in(key, number))
        steps.append((before, ENDED.pop()))
    all_steps = jax.tree.map(lambda *parts: jnp.stack(parts), *steps)
    note = jax.vmap(jax.vmap(partial(notes, config, frozen)))
    return state, jax.device_get(note(*all_steps))


def notes(config, frozen, before, after):
    """What happened in a decision of one world: from its `Rollout` before and after.

    Of every level that is not frozen above those that learn: whether it was to choose, what it saw
    and chose, and what it saw after the decision, once the frozen levels have chosen (``next``).
    """
    controller, memory, outcome = config.controller, before.memory, after.episode.outcome
    levels = controller.levels[config.leading :]
    found = {"over": outcome.over, "accident": outcome.accident, "paid": outcome.reward}
    for level in levels:
        choice = after.pending[level.name].choice[0]
        found[f"{level.name} ready"] = level.ready(memory)
        found[f"{level.name} saw"] = level.features(memory, before.percept)
        found[f"{level.name} chose"] = choice
        memory = level.choose(memory, before.percept, choice)
    found["before"] = controller.feedback(memory, before.percept).distance
    _, memory = controller.act(memory, before.percept)
    feedback = controller.feedback(memory, after.percept)
    found |= {"after": feedback.distance, "reached": feedback.reached}
    memory = controller.perceive(memory, after.percept)
    for level in controller.levels[: config.leading]:
        memory, _ = controllers.choose(level, frozen, memory, after.percept)
    for level in levels:
        found[f"{level.name} next"] = level.features(memory, after.percept)
    alike = jax.tree.map(jnp.allclose, memory, after.memory)
    return found | {"as chosen": jnp.array(jax.tree.leaves(alike)).all()}


def book(config, seen, name):
    """The rows of a level's replay, in the order in which they are written.

    Without those of the last iteration: whether a choice follows it is not noted.

    Args:
        config: of the stage.
        seen: `notes` [iterations, worlds].
        name: of the level.
    """
    level_settings = dict(config.learning)[name]
    written = []
    for world in range(seen["over"].shape[1]):
        begins = 0
        for last in [*np.flatnonzero(seen["over"][:, world]), len(seen["over"]) - 1]:
            if last >= begins:
                one = jax.tree.map(lambda leaf, w=world, b=begins, e=last: leaf[b : e + 1, w], seen)
                rows = _episode(level_settings, one, name)
                written += [(begins + end, world, -start, row) for start, end, row in rows]
            begins = last + 1
    # By decision, then by world; of those complete at once the newest choice is first.
    written.sort(key=lambda entry: entry[:3])
    return np.array([row for end, *_, row in written if end < len(seen["over"]) - 1])


def _episode(level_settings, seen, name):
    """Of one episode, maybe cut short: (first decision, last decision, row) of each transition."""
    ready = np.flatnonzero(seen[f"{name} ready"])
    over, length = bool(seen["over"][-1]), len(seen["over"])
    terminated = over and int(seen["accident"][-1]) != 0
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
        lost = terminated or level_settings.time_out == "terminal"
        lost &= over and stop == length
        lost |= level_settings.goal_end == "terminal" and bool(seen["reached"][last])
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
            *seen[f"{name} saw"][start],
            seen[f"{name} chose"][start],
            reward,
            discount,
            *seen[f"{name} next"][last],
        ]
        found.append((start, last, row))
    return found


def _pay(level_settings, seen, at, crash):
    """What a decision pays a level."""
    paid = level_settings.external_weight * float(seen["paid"][at])
    if crash:
        return paid
    before, after = float(seen["before"][at]), float(seen["after"][at])
    paid += (
        level_settings.approach_weight * (before - after) - level_settings.tracking_weight * after
    )
    return paid + level_settings.goal_reward * bool(seen["reached"][at])
