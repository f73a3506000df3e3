"""The Q-network: a multilayer perceptron as a plain tree of arrays."""

import math
from itertools import pairwise
from typing import NamedTuple

import jax
import jax.numpy as jnp


class NormalisedLayer(NamedTuple):
    """A layer whose outputs are normalised before the ReLU."""

    weights: jax.Array
    """[inputs, outputs]."""
    biases: jax.Array
    """[outputs]."""


Parameters = tuple[tuple[jax.Array, jax.Array] | NormalisedLayer, ...]
"""One pair per layer: weights [inputs, outputs] and biases [outputs]."""
VARIANCE_FLOOR = 1e-5
"""Added to the variance by which outputs are normalised."""


def init(
    key: jax.Array,
    inputs: int,
    hidden: tuple[int, ...],
    outputs: int,
    layer_normalisation: bool = False,
) -> Parameters:
    """Draws the first parameters, every layer from U(-b, b) with b = 1 / sqrt(inputs of the layer).

    Source: the default of ``torch.nn.Linear``, weights and biases alike, which is what
    Stable-Baselines3 and hence most published DQN results start from.

    Returns:
        float32 parameters of ``len(hidden) + 1`` layers.
    """
    widths = (inputs, *hidden, outputs)
    layer_keys = jax.random.split(key, len(widths) - 1)
    layers: list[tuple[jax.Array, jax.Array] | NormalisedLayer] = []
    for layer_key, (fan_in, fan_out) in zip(layer_keys, pairwise(widths), strict=True):
        weights_key, biases_key = jax.random.split(layer_key)
        bound = 1.0 / math.sqrt(fan_in)
        weights, biases = (
            jax.random.uniform(part_key, shape, jnp.float32, minval=-bound, maxval=bound)
            for part_key, shape in ((weights_key, (fan_in, fan_out)), (biases_key, (fan_out,)))
        )
        is_last = len(layers) == len(hidden)
        normalised = layer_normalisation and not is_last
        layers.append(NormalisedLayer(weights, biases) if normalised else (weights, biases))
    return tuple(layers)


def q_values(parameters: Parameters, features: jax.Array) -> jax.Array:
    """Q-values of every action [..., A], with ReLU between the layers and none after the last.

    Outputs of a `NormalisedLayer` are normalised before the ReLU.
    They have the precision of the parameters.
    """
    *hidden_layers, last_layer = parameters
    activation = features
    for layer in hidden_layers:
        activation = _layer(activation, *layer)
        if isinstance(layer, NormalisedLayer):
            activation = normalised(activation)
        activation = jax.nn.relu(activation)
    return _layer(activation, *last_layer)


def normalised(outputs: jax.Array) -> jax.Array:
    """A layer's outputs [..., n] less their mean, by their standard deviation.

    Source: Ba, Kiros and Hinton (2016), "Layer normalization", without gain and bias.
    """
    apart = outputs - jnp.mean(outputs, axis=-1, keepdims=True)
    variance = jnp.mean(jnp.square(apart), axis=-1, keepdims=True)
    return apart * jax.lax.rsqrt(variance + VARIANCE_FLOOR)


@jax.custom_vjp
def _layer(features: jax.Array, weights: jax.Array, biases: jax.Array) -> jax.Array:
    """``features @ weights + biases``, with a gradient that is the same on any number of cores.

    The gradients of weights and biases, features^T @ delta and 1^T @ delta, are sums over the
    batch. Left to itself XLA takes those sums in parts whose number follows that of the threads,
    for some sizes of batch and layer that differ from processor to processor, and rounds otherwise
    for each (jaxlib 0.10.2; `tests/learning/test_cores.py` fails without this). As products whose
    left side has been made first they are summed in one way.
    """
    return features @ weights + biases


def _layer_forward(
    features: jax.Array, weights: jax.Array, biases: jax.Array
) -> tuple[jax.Array, tuple[jax.Array, jax.Array]]:
    return _layer(features, weights, biases), (features, weights)


def _layer_backward(
    given: tuple[jax.Array, jax.Array], delta: jax.Array
) -> tuple[jax.Array, jax.Array, jax.Array]:
    features, weights = given
    inputs, errors = (part.reshape(-1, part.shape[-1]) for part in (features, delta))
    ones = jnp.ones((1, len(errors)), errors.dtype)
    return delta @ weights.T, _made(inputs.T) @ errors, (_made(ones) @ errors)[0]


def _made(array: jax.Array) -> jax.Array:
    """The array as it is, made before and apart from what comes of it."""
    same: jax.Array = jax.lax.optimization_barrier(array)  # type: ignore[no-untyped-call]
    return same


_layer.defvjp(_layer_forward, _layer_backward)
