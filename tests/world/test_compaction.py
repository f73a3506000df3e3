"""Values computed for some vehicles are those computed for all, where they were asked for."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lanewise.world import compaction, materialize


@pytest.mark.parametrize(
    ("count", "elsewhere"), [(5, False), (40, False), (5, True)],
    ids=["one word", "two words", "elsewhere"],
)  # fmt: skip
def test_the_few_and_no_others(count, elsewhere, monkeypatch):
    monkeypatch.setattr(compaction, "on_cpu", lambda: not elsewhere)
    rng = np.random.default_rng(count)
    worlds = (3, 17)
    values = jnp.asarray(rng.normal(size=(count, *worlds)), jnp.float32)
    shared = jnp.asarray(rng.normal(size=(count, 1, 1)), jnp.float32)
    other = jnp.asarray(rng.integers(0, count, (count, *worlds)), jnp.int32)

    def compute(chosen):
        mine, common, which = chosen.own((values, shared, other))
        everyone = chosen.around(values).sum(0)
        return {"a": mine * common + chosen.at(values, which), "b": everyone + chosen.vehicle}

    nothing = {"a": jnp.float32(-1.0), "b": np.zeros((count, *worlds), np.float32)}
    apply = jax.jit(lambda mask: compaction.masked_apply(mask, nothing, compute, one_in=9))
    a = values * shared + np.take_along_axis(values, other, 0)
    b = values.sum(0) + np.arange(count)[:, None, None]
    for share in (0.0, 0.03, 0.1, 0.6, 1.0):
        mask = rng.random((count, *worlds)) < share
        found = apply(mask)
        np.testing.assert_allclose(found["a"], np.where(mask, a, -1.0), rtol=1e-5, atol=1e-6)
        np.testing.assert_allclose(found["b"], np.where(mask, b, 0.0), rtol=1e-4, atol=1e-4)


def test_a_single_world_needs_no_trailing_axis_and_a_step_is_traced_once():
    traced = []

    def step():
        traced.append(1)
        return jnp.zeros(3)

    @jax.jit
    def found(mask):
        otherwise = materialize.materialize(mask, step)
        compute = lambda chosen: chosen.vehicle + 1.0  # noqa: E731
        return compaction.masked_apply(mask, otherwise, compute, one_in=2)

    np.testing.assert_array_equal(found(np.array([True, False, True])), [1.0, 0.0, 3.0])
    assert len(traced) == 1
