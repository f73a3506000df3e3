"""Pytrees as named arrays and back, so that they can be stored without pickle."""

from collections.abc import Mapping
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from lanewise.errors import CheckpointError
from lanewise.system import pinned

Tree = TypeVar("Tree")


def flatten(tree: Any) -> dict[str, np.ndarray]:
    """Every leaf by its path, such as ``learner/online/0/weights``.

    Random keys become their raw words; `unflatten` makes keys of them again.
    """
    return {
        name: np.asarray(jax.random.key_data(leaf) if _is_key(leaf) else leaf)
        for name, leaf in _leaves(tree)
    }


def shapes(tree: Any) -> dict[str, jax.ShapeDtypeStruct]:
    """Shapes of what `flatten` would return; the leaves may be shapes themselves."""
    return {name: _shape(leaf) for name, leaf in _leaves(tree)}


def unflatten(template: Tree, arrays: Mapping[str, np.ndarray]) -> Tree:
    """A pytree of jax arrays and random keys.

    Args:
        template: a pytree of the same structure, whose leaves may be shapes.
        arrays: as `flatten` returns them.

    Raises:
        CheckpointError: names the first array that is missing, superfluous, or differs.
    """
    wanted = shapes(template)
    for name in (*wanted, *arrays):
        if name not in arrays:
            raise CheckpointError(f"{name} is missing")
        if name not in wanted:
            raise CheckpointError(f"{name} does not belong there")
        expected, array = wanted[name], arrays[name]
        if array.shape != expected.shape or array.dtype != expected.dtype:
            raise CheckpointError(
                f"{name} is {array.dtype.name} {array.shape}, "
                f"expected {np.dtype(expected.dtype).name} {expected.shape}"
            )
    leaves = [_restore(leaf, arrays[name]) for name, leaf in _leaves(template)]
    restored: Tree = jax.tree.unflatten(jax.tree.structure(template), leaves)
    return restored


def _leaves(tree: Any) -> list[tuple[str, Any]]:
    paths, _ = jax.tree_util.tree_flatten_with_path(tree)
    return [(jax.tree_util.keystr(p, simple=True, separator="/"), leaf) for p, leaf in paths]


def _is_key(leaf: Any) -> bool:
    return hasattr(leaf, "dtype") and jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key)


def _shape(leaf: Any) -> jax.ShapeDtypeStruct:
    if _is_key(leaf):
        raw: jax.ShapeDtypeStruct = jax.eval_shape(jax.random.key_data, leaf)
        return raw
    shape: jax.ShapeDtypeStruct = jax.ShapeDtypeStruct(leaf.shape, leaf.dtype)  # type: ignore[no-untyped-call]
    return shape


def _restore(leaf: Any, array: np.ndarray) -> Any:
    if _is_key(leaf):
        return jax.random.wrap_key_data(jnp.asarray(array), impl=pinned.GENERATOR)
    return jnp.asarray(array)
