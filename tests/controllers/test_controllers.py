from dataclasses import replace
from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from percepts import percept_of

from lanewise.controllers import controller as controllers
from lanewise.controllers.hierarchical import Hierarchical, Planned
from lanewise.controllers.settings import GoalSettings, PlannerSettings
from lanewise.controllers.single_level import SingleLevel
from lanewise.driving import actions
from lanewise.driving.settings import DrivingSettings
from lanewise.learning import network

DRIVING, GOALS = DrivingSettings(), GoalSettings(time_limit=2.0)
PLANNED = Planned(DRIVING, GOALS, PlannerSettings(preview=3), "critic")
HIERARCHICAL = Hierarchical(DRIVING, GOALS, "critic")


@cache
@partial(jax.jit, static_argnums=0)
def networks(seed=0):
    keys = jax.random.split(jax.random.key(seed), 3)
    return {
        "high_level": network.init(keys[0], 26, (8,), 9),
        "low_level": network.init(keys[1], 28, (8,), 9),
        "single_level": network.init(keys[2], 26, (8,), 9),
    }


def percepts(count, seed=0):
    """Scattered percepts, as if the ego were thrown about the road."""
    rng = np.random.default_rng(seed)
    return [
        percept_of(
            y=float(rng.uniform(0.0, 8.0)),
            speed=float(rng.uniform(5.0, 16.0)),
            heading=float(rng.uniform(-0.1, 0.1)),
            features=jnp.asarray(rng.normal(size=26), jnp.float32),
        )
        for _ in range(count)
    ]


ACT = jax.jit(controllers.act, static_argnums=0)


def drive(controller, parameters, seen):
    """(actions, memories) of a controller over a series of percepts."""
    memory, taken, memories = controller.start(seen[0]), [], []
    for one in seen:
        action, memory, _ = ACT(controller, parameters, memory, one)
        taken.append(int(action))
        memories.append(memory)
    return taken, memories


def goals_of(memories):
    goals = [memory.goal.goal for memory in memories]
    return [(int(goal.lane), float(goal.speed)) for goal in goals]


def test_each_level_states_what_its_network_sees_and_chooses():
    seen = percepts(1)[0]
    expected = {
        "planned": [("high_level", 26, 9)],
        "hierarchical": [("high_level", 26, 9), ("low_level", 28, 9)],
        "single-level": [("single_level", 26, 9)],
    }
    for controller in (PLANNED, HIERARCHICAL, SingleLevel()):
        memory = controller.perceive(controller.start(seen), seen)
        found = [(lv.name, lv.feature_count, lv.choice_count) for lv in controller.levels]
        assert found == expected[controller.name]
        for level in controller.levels:
            assert level.features(memory, seen).shape == (level.feature_count,)
    fewer = replace(PLANNED, goals=GoalSettings(action_set="single-5"))
    assert fewer.levels[0].choice_count == 5


def test_the_single_level_controller_reads_nothing_but_the_features():
    """Everything else is missing, not merely different."""
    seen, nothing = percepts(5), dict.fromkeys(("x", "y", "heading", "speed", "lane", "road"))
    blind = [replace(one, **nothing) for one in seen]
    assert drive(SingleLevel(), networks(), blind)[0] == drive(SingleLevel(), networks(), seen)[0]


@pytest.mark.parametrize("controller", [PLANNED, HIERARCHICAL], ids=["planned", "hierarchical"])
def test_controllers_with_goals_never_read_where_along_the_road_they_are(controller):
    seen = percepts(40)
    hidden = [replace(one, x=None) for one in seen]
    taken, memories = drive(controller, networks(), seen)
    assert drive(controller, networks(), hidden)[0] == taken
    assert len(set(goals_of(memories))) > 3


def chosen(controller, seen, choice):
    """The memory of a fresh episode after the high level's choice."""
    memory = controller.perceive(controller.start(seen), seen)
    return controller.levels[0].choose(memory, seen, jnp.int32(choice))


def test_the_planner_reads_no_features():
    """The high level's features are the only road to other vehicles; the planner has none."""
    memory, act = chosen(PLANNED, percepts(1)[0], 2), jax.jit(PLANNED.act)
    for seen in percepts(6):
        assert int(act(memory, replace(seen, features=None))[0]) == int(act(memory, seen)[0])


def test_the_goal_reaches_the_low_level_as_two_features():
    seen = percept_of(y=4.0, speed=10.0, features=jnp.arange(26.0))
    memory = HIERARCHICAL.start(seen)
    goal = replace(memory.goal.goal, lane=jnp.int32(2), speed=jnp.float32(11.0))
    memory = replace(memory, goal=replace(memory.goal, goal=goal))
    features = HIERARCHICAL.levels[1].features(memory, seen)
    np.testing.assert_allclose(features, [*range(26), 1.0, 0.5], atol=1e-6)


def test_the_high_level_chooses_only_when_a_goal_is_due():
    seen = percept_of(y=4.0, speed=10.0)
    (high,) = PLANNED.levels
    assert high.ready(PLANNED.start(seen))
    _, memory = PLANNED.act(chosen(PLANNED, seen, 0), seen)
    assert (goals_of([memory]), int(memory.goal.age)) == ([(0, 9.0)], 1)
    memory = PLANNED.perceive(memory, seen)
    assert not high.ready(memory)
    assert goals_of([high.choose(memory, seen, jnp.int32(8))]) == [(0, 9.0)]


def test_feedback_is_the_distance_from_the_goal_and_whether_it_is_reached():
    seen = percept_of(y=4.0, speed=10.0)
    memory = chosen(HIERARCHICAL, seen, 2)  # one lane left, 1 m/s faster
    assert goals_of([memory]) == [(0, 11.0)]
    feedback = HIERARCHICAL.feedback(memory, seen)
    assert float(feedback.distance) == pytest.approx(4.0 / 4.0 + 1.0 / 2.0)
    assert not feedback.reached
    there = percept_of(y=0.2, speed=10.9)
    assert HIERARCHICAL.feedback(memory, there).reached
    assert float(SingleLevel().feedback(SingleLevel().start(seen), seen).distance) == 0.0


def test_act_is_greedy():
    seen, parameters = percepts(1)[0], networks()
    action, _, traces = ACT(SingleLevel(), parameters, SingleLevel().start(seen), seen)
    values = network.q_values(parameters["single_level"], seen.features)
    trace = traces["single_level"]
    np.testing.assert_allclose(trace.values, values)
    assert int(action) == int(np.argmax(values)) == int(trace.choice)
    assert int(action) in range(actions.COUNT)


def test_a_held_choice_stays_for_its_decisions():
    seen = percepts(24)
    taken, _ = drive(SingleLevel(hold=3), networks(), seen)
    free, _ = drive(SingleLevel(), networks(), seen)
    assert taken[::3] == free[::3]
    assert all(taken[i] == taken[i - i % 3] for i in range(24))
    assert taken != free
