"""Fresh episodes where one is over."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lanewise.driving import restarting

WORLDS = 20


@pytest.mark.parametrize("over", [[], [4], [0, 19], range(3, 17), range(WORLDS)], ids=len)
@pytest.mark.parametrize("elsewhere", [False, True], ids=["cpu", "elsewhere"])
def test_worlds_that_are_over_and_no_others(over, elsewhere, monkeypatch):
    monkeypatch.setattr(restarting, "on_cpu", lambda: not elsewhere)
    done = jnp.zeros(WORLDS, bool).at[jnp.array(over, int)].set(True)
    worlds = {"number": jnp.arange(WORLDS), "place": jnp.arange(WORLDS)[:, None] * jnp.ones(3)}

    def begin(which):
        return {"number": 100 + which, "place": -which[:, None] * jnp.ones(3)}

    found = jax.jit(lambda done, worlds: restarting.restart_finished(done, worlds, begin))(
        done, worlds
    )
    expected = [100 + world if world in over else world for world in range(WORLDS)]
    np.testing.assert_array_equal(found["number"], expected)
    signs = np.where(np.asarray(done), -1.0, 1.0)[:, None]
    np.testing.assert_array_equal(found["place"], signs * np.asarray(worlds["place"]))


def test_fresh_episodes_are_made_a_few_at_a_time():
    asked = []

    def begin(which):
        asked.append(which.tolist())
        return which

    with jax.disable_jit():
        restarting.restart_finished(jnp.arange(WORLDS) >= 14, jnp.full(WORLDS, -1), begin)
    assert asked == [[14, 15, 16], [17, 18, 19]]
    with jax.disable_jit():
        restarting.restart_finished(jnp.zeros(WORLDS, bool), jnp.full(WORLDS, -1), begin)
    assert len(asked) == 2
