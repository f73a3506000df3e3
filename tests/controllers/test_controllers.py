from dataclasses import replace
from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from percepts import percept_of

from lanewise.controllers import controller as controllers
from lanewise.controllers.hierarchical import Hierarchical
from lanewise.controllers.planned import Planned
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


def drive(controller, parameters, seen):
    """(actions, memories) of a controller over a series of percepts."""
    act = jax.jit(lambda memory, p: controllers.act(controller, parameters, memory, p))
    memory, taken, memories = controller.start(parameters, seen[0]), [], []
    for one in seen:
        action, memory, _ = act(memory, one)
        taken.append(int(action))
        memories.append(memory)
    return taken, memories


def goals_of(memories):
    return [(int(memory.goal.lane), float(memory.goal.speed)) for memory in memories]


def test_hierarchical_and_planned_set_the_same_goals_for_the_same_percepts():
    seen = percepts(40)
    planned, hierarchical = (
        goals_of(drive(controller, networks(), seen)[1]) for controller in (PLANNED, HIERARCHICAL)
    )
    assert hierarchical == planned
    assert len(set(planned)) > 3


def test_each_controller_states_what_its_network_sees_and_chooses():
    seen, parameters = percepts(1)[0], networks()
    expected = {"planned": (26, 9), "hierarchical": (28, 9), "single-level": (26, 9)}
    for controller in (PLANNED, HIERARCHICAL, SingleLevel()):
        memory = controller.start(parameters, seen)
        memory = controller.perceive(parameters, memory, seen)
        inputs, choices = expected[controller.name]
        assert controller.features(memory, seen).shape == (inputs,) == (controller.feature_count,)
        assert controller.choice_count == choices
    assert replace(PLANNED, goals=GoalSettings(action_set="single-5")).choice_count == 5


def test_the_single_level_controller_reads_nothing_but_the_features():
    """Everything else is missing, not merely different."""
    for seen in percepts(5):
        blind = replace(seen, x=None, y=None, heading=None, speed=None, lane=None, road=None)
        full = drive(SingleLevel(), networks(), [seen])[0]
        assert drive(SingleLevel(), networks(), [blind])[0] == full


@pytest.mark.parametrize("controller", [PLANNED, HIERARCHICAL], ids=["planned", "hierarchical"])
def test_controllers_with_goals_never_read_where_along_the_road_they_are(controller):
    seen = percepts(6)
    hidden = [replace(one, x=None) for one in seen]
    assert drive(controller, networks(), hidden)[0] == drive(controller, networks(), seen)[0]


def test_the_planner_reads_no_features():
    """The high level's features are the only road to other vehicles; the planner has none."""
    memory = PLANNED.start(networks(), percepts(1)[0])
    for seen in percepts(6):
        blind = replace(seen, features=None)
        taken, _ = PLANNED.decide(memory, seen, jnp.int32(2))
        assert int(PLANNED.decide(memory, blind, jnp.int32(2))[0]) == int(taken)


def test_the_goal_reaches_the_low_level_as_two_features():
    seen = percept_of(y=4.0, speed=10.0, features=jnp.arange(26.0))
    memory = HIERARCHICAL.start(networks(), seen)
    goal = replace(memory.goal, lane=jnp.int32(2), speed=jnp.float32(11.0))
    features = HIERARCHICAL.features(replace(memory, goal=goal), seen)
    np.testing.assert_allclose(features, [*range(26), 1.0, 0.5], atol=1e-6)


def test_the_planned_network_chooses_only_when_a_goal_is_due():
    seen = percept_of(y=4.0, speed=10.0)
    memory = PLANNED.start(networks(), seen)
    assert PLANNED.ready(memory)
    _, memory = PLANNED.decide(memory, seen, jnp.int32(0))
    assert goals_of([memory]) == [(0, 9.0)]
    memory = PLANNED.perceive(networks(), memory, seen)
    assert not PLANNED.ready(memory)
    _, ignored = PLANNED.decide(memory, seen, jnp.int32(8))
    assert goals_of([ignored]) == [(0, 9.0)]


def test_act_is_greedy():
    seen, parameters = percepts(1)[0], networks()
    action, _, trace = controllers.act(SingleLevel(), parameters, (), seen)
    values = network.q_values(parameters["single_level"], seen.features)
    np.testing.assert_allclose(trace.values, values)
    assert int(action) == int(np.argmax(values)) == int(trace.choice)
    assert int(action) in range(actions.COUNT)
