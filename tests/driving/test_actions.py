import jax.numpy as jnp
import numpy as np
import pytest
from driving_worlds import world_of
from highway_env.envs.common.action import DiscreteAction

from lanewise.driving import actions
from lanewise.driving.settings import ActionSettings, DrivingSettings
from lanewise.interop.highway_env import build_env
from lanewise.world import bicycle, motion


@pytest.fixture(scope="module")
def env():
    env = build_env(world_of([0.0], [4.0], [10.0]), acceleration=1.0, steering=np.pi / 50)
    yield env
    env.close()


@pytest.mark.parametrize("action", range(actions.COUNT))
def test_actions_are_highway_envs_discrete_actions(env, action):
    assert type(env.action_type) is DiscreteAction
    assert env.action_space.n == actions.COUNT
    env.action_type.act(action)
    theirs = env.vehicle.action
    acceleration, steering = actions.commands(
        ActionSettings(), jnp.int32(action), jnp.dtype(jnp.float32)
    )
    assert float(acceleration) == pytest.approx(theirs["acceleration"], abs=1e-6)
    assert float(steering) == pytest.approx(theirs["steering"], abs=1e-6)


def test_index_is_the_inverse_of_signs():
    every = jnp.arange(actions.COUNT)
    np.testing.assert_array_equal(actions.index(*actions.signs(every)), every)
    assert [int(sign) for sign in actions.signs(jnp.int32(actions.IDLE))] == [0, 0]


def test_shares_of_the_commands_are_clipped():
    settings = ActionSettings(acceleration=2.0, steering=0.1)
    for shares, expected in (((0.5, -0.5), (1.0, -0.05)), ((3.0, -7.0), (2.0, -0.1))):
        commands = actions.shared(settings, jnp.array(shares))
        np.testing.assert_allclose(commands, expected, rtol=1e-6)


def test_positive_steering_turns_to_the_right():
    world = world_of([0.0], [4.0], [10.0])
    right = actions.index(jnp.int32(0), jnp.int32(1))
    commands = actions.commands(DrivingSettings().actions, right, jnp.dtype(jnp.float32))
    moved = bicycle.move(
        bicycle.command(world, *commands), motion.heading_trig(world.vehicles), 0.1
    )
    assert float(moved.vehicles.heading[0]) > 0
    assert float(moved.vehicles.y[0]) > 4.0
