"""Exported policies drive test episodes: the file decides, not the run that it comes from."""

from dataclasses import replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from lanewise.controllers.controller import Memory
from lanewise.controllers.goals import Goal
from lanewise.controllers.hierarchical import TwoLevelMemory
from lanewise.driving.task_functions import PAPER_TASK, TaskFunctions
from lanewise.evaluation.evaluator import Drive, EvaluationConfig
from lanewise.evaluation.stepwise import Booleans, StepPolicy
from lanewise.export.numpy_policy import Ego, Policy
from lanewise.export.numpy_policy import Memory as Parts
from lanewise.export.policy_file import PolicyFile, is_policy_file
from lanewise.runs import trained
from lanewise.runs.trained import Exported, Trained
from lanewise.system import pinned


def load(path: Path, task: TaskFunctions = PAPER_TASK) -> Trained:
    """The controller that a path leads to: a file of ``lanewise export``, or as `trained.load`.

    Raises:
        LanewiseError: there is no such controller, it has no weights yet, or a file is damaged.
    """
    if not is_policy_file(path):
        return trained.load(path, task)
    file = PolicyFile.open(path)
    who = Exported(file.policy.feature_count, step_policy(file.policy))
    return Trained(
        file.controller, file.settings, file.seed, {}, task, trained_with=file.task, exported=who
    )


def step_policy(policy: Policy) -> StepPolicy:
    """An exported policy in place of a controller's own networks, with a memory of its own."""
    own: Parts = {}

    def choose(
        config: EvaluationConfig, drive: Drive, wanted: Booleans, first: bool
    ) -> tuple[Array, Memory]:
        seen = jax.device_get(drive.percept)
        if first:
            own.update(policy.start(len(seen.features)))
        centres = np.where(seen.road.present, seen.road.centre, np.float32(np.inf))
        ego = Ego(seen.y, seen.heading, seen.speed, centres) if policy.has_goals else None
        action, memory, _ = policy.step(seen.features, ego, dict(own))
        own.update(memory)
        return jnp.asarray(action, jnp.int32), _remembered(config, drive, memory)

    return choose


@pinned.jit(static_argnums=0)
def _remembered(config: EvaluationConfig, drive: Drive, parts: dict[str, Array]) -> Memory:
    """The controller's memory after a decision, with the parts of the policy's; [B]."""

    def one(drive: Drive, parts: dict[str, Array]) -> Memory:
        memory = config.controller.perceive(drive.memory, drive.percept)
        if isinstance(memory, TwoLevelMemory):
            kept = memory.goal.goal
            goal = Goal(
                parts["goal_lane"].astype(kept.lane.dtype),
                parts["goal_speed"].astype(kept.speed.dtype),
            )
            age = parts["age"].astype(memory.goal.age.dtype)
            under_way = replace(memory.goal, goal=goal, age=age, due=parts["begins"])
            return replace(memory, goal=under_way)
        if parts:
            held, age = (parts[name].astype(jnp.int32) for name in ("held", "age"))
            return replace(memory, action=held, age=age)
        return memory

    kept: Memory = jax.vmap(one)(drive, parts)
    return kept
