"""Controllers without training and made-up drives, for the tests of exported policies."""

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np

from lanewise import config
from lanewise.controllers import controller as controllers
from lanewise.driving.percept import Percept
from lanewise.export import check
from lanewise.learning import network
from lanewise.runs.trained import Trained
from lanewise.training import recipe
from lanewise.world import road

CASES = {
    "hierarchical": ("hierarchical", {}),
    "h-dqn": ("h-dqn", {"goals.reference": "current-state", "goals.action_set": "joint-6"}),
    "planned": ("planned", {"goals.action_set": "single-5", "goals.time_limit": 1.5}),
    "planned-short": ("planned", {"planner.preview": 2, "driving.actions.acceleration": 1.3}),
    "single-level": ("single-level", {}),
    "single-level-held": ("single-level", {"single_level.hold": 3}),
}
STEPS, BATCH, LANES = 30, 40, 5


@cache
def untrained(case):
    """A controller with random weights, large enough that its choices vary."""
    name, flags = CASES[case]
    settings = config.compose(preset="quick", trap="trap-10", file=None, flags=flags)
    parameters = {}
    for number, level in enumerate(recipe.evaluation_config(settings, name).controller.levels):
        key = jax.random.key(number)
        (weights, biases), *rest = network.init(key, level.feature_count, (32,), level.choice_count)
        parameters[level.name] = ((8 * weights, 8 * biases), *rest)
    return Trained(name, settings, 0, parameters)


@cache
def percepts():
    """[STEPS, BATCH] percepts of cars that wander over 3 to 5 lanes, often near a goal."""
    rng = np.random.default_rng(0)
    lanes = rng.integers(3, LANES + 1, BATCH)
    shape = (STEPS, BATCH)
    lane = np.clip(1 + rng.integers(-1, 2, shape).cumsum(0), 0, lanes - 1)
    y = 4.0 * lane + rng.choice([0.0, 0.1, -0.25, 1.0, -1.9], shape)
    speed = 10.0 + 0.5 * np.clip(rng.integers(-1, 2, shape).cumsum(0), -12, 14)
    heading = rng.choice([0.0, 0.002, -0.06, 0.1, 0.25], shape)
    features = rng.uniform(-1.5, 1.5, (*shape, 26))
    roads = jax.vmap(lambda count: road.straight_road(count, lanes_max=LANES))(jnp.asarray(lanes))
    return Percept(
        **{
            name: jnp.asarray(value, jnp.float32)
            for name, value in {
                "features": features,
                "x": np.zeros(shape),
                "y": y,
                "heading": heading,
                "speed": speed,
            }.items()
        },
        lane=jnp.asarray(lane, jnp.int32),
        road=jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (STEPS, *leaf.shape)), roads),
    )


@cache
def decisions(case):
    """What the JAX controller decides, shown the percepts one after the other."""
    trained = untrained(case)
    controller = recipe.evaluation_config(trained.settings, trained.name).controller

    def decide(memory, percept):
        action, memory, traces = controllers.act(controller, trained.parameters, memory, percept)
        live = jnp.bool_(True)
        return memory, check.decision(controller, percept, action, memory, traces, live)

    def one(seen):
        first = jax.tree.map(lambda leaf: leaf[0], seen)
        return jax.lax.scan(decide, controller.start(first), seen)[1]

    return jax.device_get(jax.jit(jax.vmap(one, in_axes=1, out_axes=1))(percepts()))
