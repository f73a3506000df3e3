"""Pytrees as named arrays and back, so that they can be stored without pickle."""

from collections.abc import Mapping
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from lanewise.errors import CheckpointError

Tree = TypeVar("Tree")


def flatten(tree: Any) -> dict[str, np.ndarray]:
    """Every leaf by its path, such as ``learner/online/0/weights``.

    Random keys become their raw words; ``unflatten`` makes keys of them again.
    """
    return {name: np.asarray(_raw(leaf)) for name, leaf in _leaves(tree)}


def shapes(tree: Any) -> dict[str, jax.ShapeDtypeStruct]:
    """What ``flatten`` would return, as shapes only; leaves may be shapes themselves."""
    return {name: _shape(leaf) for name, leaf in _leaves(tree)}


def unflatten(template: Tree, arrays: Mapping[str, np.ndarray]) -> Tree:
    """Puts arrays back in the places of a template, whose own values do not matter.

    Raises:
        CheckpointError: An array is missing, superfluous, or of another type or shape.
    """
    named = _leaves(template)
    extra = arrays.keys() - {name for name, _ in named}
    if extra:
        raise CheckpointError(f"{min(extra)} does not belong there")
    leaves = [_restore(name, leaf, arrays) for name, leaf in named]
    restored: Tree = jax.tree.unflatten(jax.tree.structure(template), leaves)
    return restored


def _leaves(tree: Any) -> list[tuple[str, Any]]:
    paths, _ = jax.tree_util.tree_flatten_with_path(tree)
    named = [(jax.tree_util.keystr(p, simple=True, separator="/"), leaf) for p, leaf in paths]
    if len(dict(named)) != len(named):
        raise ValueError("two leaves have the same path")
    return named


def _is_key(leaf: Any) -> bool:
    return hasattr(leaf, "dtype") and jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key)


def _raw(leaf: Any) -> Any:
    return jax.random.key_data(leaf) if _is_key(leaf) else leaf


def _shape(leaf: Any) -> jax.ShapeDtypeStruct:
    if _is_key(leaf):
        raw: jax.ShapeDtypeStruct = jax.eval_shape(jax.random.key_data, leaf)
        return raw
    # Not eval_shape: without x64 it would turn a NumPy leaf's int64 into int32.
    leaf = leaf if hasattr(leaf, "dtype") else np.asarray(leaf)
    shape: jax.ShapeDtypeStruct = jax.ShapeDtypeStruct(leaf.shape, leaf.dtype)  # type: ignore[no-untyped-call]
    return shape


def _restore(name: str, leaf: Any, arrays: Mapping[str, np.ndarray]) -> Any:
    if name not in arrays:
        raise CheckpointError(f"{name} is missing")
    array = arrays[name]
    expected = _shape(leaf)
    if array.shape != expected.shape or array.dtype != expected.dtype:
        raise CheckpointError(
            f"{name} is {array.dtype.name} {array.shape}, "
            f"expected {expected.dtype.name} {expected.shape}"
        )
    if _is_key(leaf):
        return jax.random.wrap_key_data(jnp.asarray(array), impl=_implementation(leaf))
    if isinstance(leaf, np.ndarray | np.generic):
        return array
    if isinstance(leaf, bool | int | float):
        return type(leaf)(array.item())
    return jnp.asarray(array)


def _implementation(leaf: Any) -> Any:
    """The generator of a key; a mere shape is made into a key to ask for it."""
    if isinstance(leaf, jax.ShapeDtypeStruct):
        leaf = jnp.zeros((), leaf.dtype)
    return jax.random.key_impl(leaf)
