"""The network against plain NumPy, and its first parameters against their claim."""

import jax
import numpy as np
import pytest

from lanewise.learning import network

q_values = jax.jit(network.q_values)
init = jax.jit(network.init, static_argnums=(1, 2, 3))


@pytest.mark.parametrize("hidden", [(5, 4), ()], ids=str)
def test_q_values_of_a_batch_equal_loops(hidden):
    parameters = init(jax.random.key(0), 3, hidden, 2)
    batch = np.array([[[0.5, -1.0, 2.0], [1.0, 2.0, -3.0]]], np.float32)
    found = q_values(parameters, batch)
    layers = [(np.asarray(weights), np.asarray(biases)) for weights, biases in parameters]
    for number, activation in enumerate(batch[0].tolist()):
        for depth, (weights, biases) in enumerate(layers):
            activation = [
                float(biases[j]) + sum(a * float(weights[i, j]) for i, a in enumerate(activation))
                for j in range(len(biases))
            ]
            if depth < len(hidden):
                activation = [max(a, 0.0) for a in activation]
        assert min(activation) < 0.0
        np.testing.assert_allclose(found[0, number], activation, rtol=1e-5)


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
