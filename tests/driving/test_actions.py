import jax
import jax.numpy as jnp
import numpy as np
import pytest
from highway_env.envs.common.action import DiscreteAction

from lanewise.driving import actions
from lanewise.driving.settings import ActionSettings
from lanewise.interop.highway_env import build_env
from small_worlds import make_world

COMMANDS = jax.jit(actions.commands, static_argnums=(0, 2))


def test_actions_are_highway_envs_discrete_actions():
    env = build_env(make_world([0.0], [1], 10.0), acceleration=1.0, steering=np.pi / 50)
    assert type(env.action_type) is DiscreteAction
    assert env.action_space.n == actions.COUNT
    for action in range(actions.COUNT):
        env.action_type.act(action)
        theirs = env.vehicle.action["acceleration"], env.vehicle.action["steering"]
        ours = COMMANDS(ActionSettings(), jnp.int32(action), jnp.dtype(jnp.float32))
        np.testing.assert_allclose(ours, theirs, atol=1e-6)
    env.close()


def test_index_is_the_inverse_of_signs():
    every = jnp.arange(actions.COUNT)
    np.testing.assert_array_equal(actions.index(*actions.signs(every)), every)
    assert [int(sign) for sign in actions.signs(jnp.int32(actions.IDLE))] == [0, 0]


@pytest.mark.parametrize(
    ("shares", "expected"), [((0.5, -0.5), (1.0, -0.05)), ((3.0, -7.0), (2.0, -0.1))]
)
def test_shares_of_the_commands_are_clipped(shares, expected):
    settings = ActionSettings(acceleration=2.0, steering=0.1)
    found = COMMANDS(settings, jnp.array(shares), jnp.dtype(jnp.float32))
    np.testing.assert_allclose(found, expected, rtol=1e-6)
