"""Values computed for some vehicles are those computed for all, where they were asked for."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lanewise.world import compaction, materialize


@pytest.mark.parametrize("count", [5, 40], ids=["one word", "two words"])
@pytest.mark.parametrize("share", [0.0, 0.03, 0.1, 0.6, 1.0])
@pytest.mark.parametrize("elsewhere", [False, True], ids=["cpu", "elsewhere"])
def test_the_few_and_no_others(count, share, elsewhere, monkeypatch):
    monkeypatch.setattr(compaction, "on_cpu", lambda: not elsewhere)
    rng = np.random.default_rng(round(100 * share) + count)
    worlds = (3, 17)
    mask = jnp.asarray(rng.random((count, *worlds)) < share)
    values = jnp.asarray(rng.normal(size=(count, *worlds)), jnp.float32)
    shared = jnp.asarray(rng.normal(size=(count, 1, 1)), jnp.float32)
    other = jnp.asarray(rng.integers(0, count, (count, *worlds)), jnp.int32)

    def compute(chosen):
        mine, common, which = chosen.own((values, shared, other))
        everyone = chosen.around(values).sum(0)
        return {"a": mine * common + chosen.at(values, which), "b": everyone + chosen.vehicle}

    nothing = {"a": jnp.float32(-1.0), "b": jnp.zeros((count, *worlds), jnp.float32)}
    found = jax.jit(lambda mask: compaction.masked_apply(mask, nothing, compute, one_in=9))(mask)
    a = values * shared + np.take_along_axis(values, other, 0)
    b = values.sum(0) + np.arange(count)[:, None, None]
    np.testing.assert_allclose(found["a"], np.where(mask, a, -1.0), rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(found["b"], np.where(mask, b, 0.0), rtol=1e-4, atol=1e-4)


def test_a_single_world_needs_no_trailing_axis():
    mask = jnp.array([True, False, True])
    found = compaction.masked_apply(
        mask, jnp.zeros(3), lambda chosen: chosen.vehicle + 1.0, one_in=2
    )
    np.testing.assert_array_equal(found, [1.0, 0.0, 3.0])


def test_a_step_computed_once_is_traced_once():
    traced = []

    def step():
        traced.append(1)
        return jnp.arange(3.0)

    jax.jit(lambda present: materialize.materialize(present, step))(np.ones(3, bool))
    assert len(traced) == 1
