"""From a decision's outcome through the replay to the learner's target, in numbers done by hand.

One feature, two actions, gamma = 1/2; Q(s) = (s, 2 s) online and (10 s, 4 s) in the target network,
so that double Q-learning values s > 0 at 4 s, and plain at 10 s.
"""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lanewise.controllers.controller import Feedback
from lanewise.driving.episode import Outcome
from lanewise.learning import learner, replay
from lanewise.learning.settings import LearnerSettings
from lanewise.training import transitions
from lanewise.training.settings import LevelSettings

LEARNER = LearnerSettings(hidden=(), discount=0.5, batch_size=1, replay_capacity=4)
FRESH = 100.0
"""What the next episode begins with; no target may hold 4 * 100 or 10 * 100."""
update = jax.jit(learner.update, static_argnums=0)


def targets_of(level_settings, decisions, end):
    """The targets (double, plain) of the first choice after these decisions.

    Args:
        level_settings: settings of the level.
        decisions: (reward, distance from the goal after it, goal reached, level ready after it).
        end: ``going on``, ``terminated`` or ``truncated``, of the last decision.
    """
    pending = transitions.push(
        transitions.empty(level_settings, 1), jnp.float32([1.0]), jnp.int32(1)
    )
    memory = replay.empty(4, 1)
    for number, (reward, distance, reached, ready) in enumerate(decisions, start=1):
        last = number == len(decisions)
        outcome = Outcome(
            reward=jnp.float32(reward),
            accident=jnp.int32(0),
            terminated=jnp.bool_(last and end == "terminated"),
            truncated=jnp.bool_(last and end == "truncated"),
        )
        feedback = Feedback(distance=jnp.float32(distance), reached=jnp.bool_(reached))
        pending = transitions.accumulate(
            level_settings, pending, outcome, feedback, jnp.float32(2.0)
        )
        emitted = transitions.emit(
            level_settings, pending, outcome, feedback, jnp.float32([3.0]), jnp.bool_(ready)
        )
        memory = replay.add(memory, emitted.transitions, emitted.complete)
        if last and end != "going on":
            # The world begins anew; what is written next must not change what was written.
            pending = transitions.push(
                transitions.empty(level_settings, 1), jnp.float32([FRESH]), jnp.int32(0)
            )
            fresh = transitions.accumulate(
                level_settings, pending, replace_reward(outcome), feedback, 0.0
            )
            later = transitions.emit(
                level_settings,
                fresh,
                replace_reward(outcome),
                feedback,
                jnp.float32([FRESH]),
                jnp.bool_(True),
            )
            memory = replay.add(memory, later.transitions, later.complete)
            assert int(memory.position) == 2
            assert float(memory.rows[1, 2]) == pytest.approx(float(fresh.reward[0]))
    batch = jax.tree.map(lambda leaf: leaf[:1], replay._unpack(memory.rows))
    assert float(batch.features[0, 0]) == 1.0
    assert int(batch.action[0]) == 1
    return tuple(target_of(replace(LEARNER, double=double), batch) for double in (True, False))


def replace_reward(outcome):
    """The first decision of the next episode: another reward, nothing over."""
    no = jnp.bool_(False)
    return replace(outcome, reward=jnp.float32(77.0), terminated=no, truncated=no)


def target_of(settings, batch):
    state = learner.begin(jax.random.key(0), settings, 1, 2)
    networks = [((jnp.float32([row]), jnp.zeros(2)),) for row in ([1.0, 2.0], [10.0, 4.0])]
    state = replace(state, online=networks[0], target=networks[1])
    _, metrics = update(settings, state, batch)
    assert float(metrics.loss) == pytest.approx((float(metrics.mean_target) - 2.0) ** 2, rel=1e-5)
    return float(metrics.mean_target)


def level(**changes):
    return LevelSettings(learner=LEARNER, **changes)


ONE = [(0.25, 0.0, False, True)]
GOAL = [(1.0, 0.0, False, False), (2.0, 0.0, False, False), (4.0, 0.0, True, True)]
"""A goal of three decisions, reached by the last."""
PAID = {"tracking_weight": 0.5, "approach_weight": 3.0, "goal_reward": 8.0}
DONE = [(-2.0, 0.5, True, True)]
"""From 2 to 0.5 of the goal: r = -2 - 0.25 + 4.5 + 8 = 10.25, after an accident -2 alone."""


@pytest.mark.parametrize(
    ("level_settings", "decisions", "end", "double", "plain"),
    [
        (level(), ONE, "going on", 0.25 + 0.5 * 12, 0.25 + 0.5 * 30),
        (level(), ONE, "terminated", 0.25, 0.25),
        (level(), ONE, "truncated", 0.25 + 0.5 * 12, 0.25 + 0.5 * 30),
        (level(time_out="terminal"), ONE, "truncated", 0.25, 0.25),
        (level(), GOAL, "going on", 7 + 0.5 * 12, 7 + 0.5 * 30),
        (level(), GOAL, "terminated", 7, 7),
        (level(), GOAL, "truncated", 7 + 0.5 * 12, 7 + 0.5 * 30),
        (
            level(discount_across_goal="per-decision"),
            GOAL,
            "going on",
            1 + 2 / 2 + 4 / 4 + 12 / 8,
            1 + 2 / 2 + 4 / 4 + 30 / 8,
        ),
        (level(discount_across_goal="per-decision"), GOAL, "terminated", 3, 3),
        (level(goal_end="terminal"), GOAL, "going on", 7, 7),
        (level(goal_end="terminal"), ONE, "going on", 0.25 + 0.5 * 12, 0.25 + 0.5 * 30),
        (level(**PAID), DONE, "going on", 10.25 + 0.5 * 12, 10.25 + 0.5 * 30),
        (level(**PAID), DONE, "terminated", -2, -2),
        (level(external_weight=0.0, **PAID), DONE, "terminated", 0, 0),
        (level(**PAID, goal_end="terminal"), DONE, "going on", 10.25, 10.25),
    ],
)
def test_targets(level_settings, decisions, end, double, plain):
    np.testing.assert_allclose(
        targets_of(level_settings, decisions, end), (double, plain), rtol=1e-6
    )
