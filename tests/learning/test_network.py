"""The network against loops in plain Python, and its first parameters against their claim."""

import jax
import jax.numpy as jnp
import numpy as np

from lanewise.learning import network


def test_q_values_equal_loops():
    parameters = network.init(jax.random.key(0), 3, (5, 4), 2)
    features = [0.5, -1.0, 2.0]
    activation = features
    for depth, (weights, biases) in enumerate(parameters):
        activation = [
            float(biases[j]) + sum(a * float(weights[i, j]) for i, a in enumerate(activation))
            for j in range(len(biases))
        ]
        if depth < 2:
            activation = [max(a, 0.0) for a in activation]
    np.testing.assert_allclose(
        network.q_values(parameters, jnp.array(features)), activation, rtol=1e-5
    )


def test_a_network_without_hidden_layers_is_linear():
    ((weights, biases),) = network.init(jax.random.key(0), 3, (), 2)
    q = network.q_values(((weights, biases),), jnp.eye(3))
    np.testing.assert_allclose(q, weights + biases, rtol=1e-6)


def test_a_batch_is_its_members():
    parameters = network.init(jax.random.key(1), 4, (8,), 3)
    features = jax.random.normal(jax.random.key(2), (2, 5, 4))
    whole = network.q_values(parameters, features)
    assert whole.shape == (2, 5, 3)
    np.testing.assert_allclose(
        whole[1, 3], network.q_values(parameters, features[1, 3]), rtol=1e-5, atol=1e-6
    )


def test_first_parameters_are_uniform_within_one_over_root_fan_in():
    parameters = network.init(jax.random.key(5), 26, (512, 512), 9)
    for fan_in, (weights, biases) in zip((26, 512, 512), parameters, strict=True):
        bound = fan_in**-0.5
        assert weights.shape[0] == fan_in
        assert weights.dtype == biases.dtype == jnp.float32
        assert float(jnp.abs(weights).max()) <= bound
        assert float(jnp.abs(biases).max()) <= bound
        assert float(jnp.abs(weights).max()) > 0.99 * bound
        # A uniform variable on (-b, b) has standard deviation b / sqrt(3).
        np.testing.assert_allclose(float(weights.std()), bound / 3**0.5, rtol=0.05)
        assert biases.any()


def test_layers_and_seeds_differ():
    first = network.init(jax.random.key(0), 4, (4, 4), 4)
    other = network.init(jax.random.key(1), 4, (4, 4), 4)
    assert not np.array_equal(first[0][0], other[0][0])
    assert not np.array_equal(first[0][0], first[1][0])
    assert not np.array_equal(first[0][1], first[0][0][0])
