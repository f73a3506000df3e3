"""Fresh episodes where one is over."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lanewise.driving import restarting

WORLDS = 20


@pytest.mark.parametrize("elsewhere", [False, True], ids=["cpu", "elsewhere"])
def test_worlds_that_are_over_and_no_others(elsewhere, monkeypatch):
    monkeypatch.setattr(restarting, "on_cpu", lambda: not elsewhere)
    worlds = {"number": np.arange(WORLDS), "place": np.arange(WORLDS)[:, None] * np.ones(3)}

    def begin(which):
        return {"number": 100 + which, "place": -which[:, None] * jnp.ones(3)}

    restarted = jax.jit(lambda done: restarting.restart_finished(done, worlds, begin))
    for over in ([], [4], [0, 19], range(3, 17), range(WORLDS)):
        done = np.isin(np.arange(WORLDS), over)
        found = restarted(done)
        np.testing.assert_array_equal(found["number"], worlds["number"] + 100 * done)
        signs = np.where(done, -1.0, 1.0)[:, None]
        np.testing.assert_array_equal(found["place"], signs * worlds["place"])


def test_fresh_episodes_are_made_a_few_at_a_time():
    asked = []

    def begin(which):
        asked.append(which.tolist())
        return which

    with jax.disable_jit():
        for done in (jnp.arange(WORLDS) >= 14, jnp.zeros(WORLDS, bool)):
            restarting.restart_finished(done, jnp.full(WORLDS, -1), begin)
    assert asked == [[14, 15, 16], [17, 18, 19]]
