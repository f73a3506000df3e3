"""The Q-network: a multilayer perceptron as a plain tree of arrays."""

import math
from itertools import pairwise

import jax
import jax.numpy as jnp

Parameters = tuple[tuple[jax.Array, jax.Array], ...]
"""One pair per layer: weights [inputs, outputs] and biases [outputs]."""


def init(key: jax.Array, inputs: int, hidden: tuple[int, ...], outputs: int) -> Parameters:
    """Draws the first parameters, every layer from U(-b, b) with b = 1 / sqrt(inputs of the layer).

    Source: the default of ``torch.nn.Linear``, weights and biases alike, which is what
    Stable-Baselines3 and hence most published DQN results start from.

    Args:
        key: Random key.
        inputs: Number of features F.
        hidden: Widths of the hidden layers, possibly none.
        outputs: Number of actions A.

    Returns:
        float32 parameters of ``len(hidden) + 1`` layers.
    """
    widths = (inputs, *hidden, outputs)
    layer_keys = jax.random.split(key, len(widths) - 1)
    layers = []
    for layer_key, (fan_in, fan_out) in zip(layer_keys, pairwise(widths), strict=True):
        weights_key, biases_key = jax.random.split(layer_key)
        bound = 1.0 / math.sqrt(fan_in)
        weights = jax.random.uniform(
            weights_key, (fan_in, fan_out), jnp.float32, minval=-bound, maxval=bound
        )
        biases = jax.random.uniform(
            biases_key, (fan_out,), jnp.float32, minval=-bound, maxval=bound
        )
        layers.append((weights, biases))
    return tuple(layers)


def q_values(parameters: Parameters, features: jax.Array) -> jax.Array:
    """Q-values of every action, with ReLU between the layers and none after the last.

    Args:
        parameters: As from ``init``.
        features: [..., F].

    Returns:
        [..., A], in the precision of the parameters.
    """
    *hidden_layers, (last_weights, last_biases) = parameters
    activation = features
    for weights, biases in hidden_layers:
        activation = jax.nn.relu(_product(activation, weights) + biases)
    return _product(activation, last_weights) + last_biases


@jax.custom_vjp
def _product(features: jax.Array, weights: jax.Array) -> jax.Array:
    """``features @ weights``, with a gradient that is the same on any number of cores.

    The gradient of the weights is features^T @ delta. Given that transposed product, XLA sums over
    the batch in parts whose number follows that of the threads, for some sizes of batch and layer,
    and rounds otherwise for each (jaxlib 0.10.2; `tests/learning/test_cores.py` fails without
    this). So the transposed features are made first.
    """
    return features @ weights


def _product_forward(
    features: jax.Array, weights: jax.Array
) -> tuple[jax.Array, tuple[jax.Array, jax.Array]]:
    return features @ weights, (features, weights)


def _product_backward(
    given: tuple[jax.Array, jax.Array], delta: jax.Array
) -> tuple[jax.Array, jax.Array]:
    features, weights = given
    rows = features.reshape(-1, features.shape[-1])
    transposed: jax.Array = jax.lax.optimization_barrier(rows.T)  # type: ignore[no-untyped-call]
    return delta @ weights.T, transposed @ delta.reshape(-1, delta.shape[-1])


_product.defvjp(_product_forward, _product_backward)
