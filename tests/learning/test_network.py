"""A network's first parameters against their claim."""

import jax
import numpy as np

from lanewise.learning import network

init = jax.jit(network.init, static_argnums=(1, 2, 3))


def test_first_parameters_are_uniform_within_one_over_root_fan_in():
    parameters = init(jax.random.key(5), 26, (512, 512), 9)
    for fan_in, layer in zip((26, 512, 512), parameters, strict=True):
        weights, biases = map(np.asarray, layer)
        bound = fan_in**-0.5
        assert weights.shape[0] == fan_in
        assert weights.dtype == biases.dtype == np.float32
        assert 0.99 * bound < np.abs(weights).max() <= bound
        assert np.abs(biases).max() <= bound
        # A uniform variable on (-b, b) has standard deviation b / sqrt(3).
        np.testing.assert_allclose(weights.std(), bound / 3**0.5, rtol=0.05)


def test_layers_and_seeds_differ():
    first, other = (init(jax.random.key(seed), 4, (4, 4), 4) for seed in (0, 1))
    assert not np.array_equal(first[0][0], other[0][0])
    assert not np.array_equal(first[0][0], first[1][0])
    assert not np.array_equal(first[0][1], first[0][0][0])


def test_outputs_of_normalised_layers_have_mean_0_and_variance_1():
    parameters = network.init(jax.random.key(0), 6, (16, 8), 3, layer_normalisation=True)
    features = np.random.default_rng(0).normal(size=(40, 6)).astype(np.float32)
    activation = features
    for weights, biases in parameters[:-1]:
        outputs = activation @ np.asarray(weights) + np.asarray(biases)
        mean, variance = (getattr(outputs, name)(axis=1, keepdims=True) for name in ("mean", "var"))
        activation = np.maximum((outputs - mean) / np.sqrt(variance + 1e-5), 0.0)
    weights, biases = map(np.asarray, parameters[-1])
    found = jax.jit(network.q_values)(parameters, features)
    np.testing.assert_allclose(found, activation @ weights + biases, atol=1e-5)
    plain = network.init(jax.random.key(0), 6, (16, 8), 3)
    np.testing.assert_array_equal(plain[0][0], parameters[0].weights)
    assert not np.allclose(jax.jit(network.q_values)(plain, features), found, atol=0.1)
