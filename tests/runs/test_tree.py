from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lanewise.errors import CheckpointError
from lanewise.runs import tree
from lanewise.runs.checkpoint import load, save


class State(NamedTuple):
    weights: list
    keys: jax.Array
    count: int
    total: np.ndarray


def make(seed):
    key = jax.random.key(seed)
    return State(
        weights=[{"w": jax.random.normal(key, (2, 3)), "b": jnp.zeros(3, jnp.bfloat16)}],
        keys=jax.random.split(key, 4),
        count=seed,
        total=np.array(seed, dtype=np.int64),
    )


def test_names_are_readable():
    assert list(tree.flatten(make(0))) == ["weights/0/b", "weights/0/w", "keys", "count", "total"]


@pytest.mark.parametrize("dtype", ["bfloat16"])
def test_a_tree_survives_the_disk(tmp_path, dtype):
    original, template = make(5), make(0)
    original = original._replace(weights=[{"w": original.weights[0]["w"], "b": jnp.ones(3)}])
    template = template._replace(weights=[{"w": template.weights[0]["w"], "b": jnp.zeros(3)}])
    save(tmp_path, "state", tree.flatten(original), {}, "d")
    arrays = load(tmp_path, "state", tree.shapes(template)).arrays
    restored = tree.unflatten(template, arrays)
    assert jax.tree.structure(restored) == jax.tree.structure(original)
    for ours, theirs in zip(jax.tree.leaves(restored), jax.tree.leaves(original), strict=True):
        assert type(ours) is type(theirs)
        assert jnp.all(ours == theirs)
    np.testing.assert_array_equal(
        jax.random.normal(restored.keys[2], (3,)), jax.random.normal(original.keys[2], (3,))
    )


def test_shapes_agree_with_flatten_and_need_no_values():
    def only_arrays(seed):
        return make(0)._replace(count=jnp.asarray(seed), total=jnp.zeros(()))

    flat = tree.flatten(only_arrays(1))
    traced = tree.shapes(jax.eval_shape(only_arrays, 1))
    assert {k: (v.shape, v.dtype) for k, v in traced.items()} == {
        k: (v.shape, v.dtype) for k, v in flat.items()
    }
    restored = tree.unflatten(jax.eval_shape(only_arrays, 1), flat)
    assert jnp.all(restored.keys == only_arrays(1).keys)


@pytest.mark.parametrize("implementation", ["threefry2x32", "rbg"])
def test_every_generator_of_keys(implementation):
    key = jax.random.key(3, impl=implementation)
    restored = tree.unflatten(jax.random.key(0, impl=implementation), tree.flatten(key))
    assert restored == key


@pytest.mark.parametrize(
    ("change", "hint"),
    [
        ({"more": np.zeros(1)}, "more does not belong"),
        ({"keys": np.zeros((4, 2), np.int32)}, "keys is int32"),
        ({"weights/0/w": np.zeros((3, 2), np.float32)}, r"expected float32 \(2, 3\)"),
    ],
)
def test_wrong_arrays_are_refused(change, hint):
    with pytest.raises(CheckpointError, match=hint):
        tree.unflatten(make(0), tree.flatten(make(0)) | change)
    with pytest.raises(CheckpointError, match="weights/0/b is missing"):
        tree.unflatten(make(0), {})
