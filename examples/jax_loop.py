"""PPO in plain JAX and Optax on the trap, flat, the whole training in one compiled call.

`lanewise.envs.functional` is the trap as pure functions: ``vmap`` makes 512 worlds of it, ``scan``
a loop. Nothing restarts by itself, so a time limit is valued right without a wrapper: the last
observation of an episode that ended is in `Step.observation`, the fresh one comes from `restarted`.

python examples/jax_loop.py --steps 300000 --seed 0
"""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax
import tyro
from jax import Array

import lanewise
from lanewise import Evaluation
from lanewise.envs import functional

TASK = functional.make()
WORLDS, LENGTH, EPOCHS, BATCHES = 512, 32, 4, 8
DISCOUNT, TRACE, CLIP, ENTROPY = 0.95, 0.9, 0.2, 0.01
OPTIMISER = optax.chain(optax.clip_by_global_norm(0.5), optax.adam(1e-3))


def network(key: Array) -> list[Any]:
    """Two hidden layers; nine preferences and a value."""
    sizes = ((26, 128), (128, 128), (128, 10))
    keys = jax.random.split(key, len(sizes))
    return [
        (jax.random.normal(k, s) / jnp.sqrt(s[0]), jnp.zeros(s[1]))
        for k, s in zip(keys, sizes, strict=True)
    ]


def judge(weights: Any, seen: Array) -> tuple[Array, Array]:
    """(preferences [..., 9], value [...])."""
    for matrix, offset in weights[:-1]:
        seen = jnp.tanh(seen @ matrix + offset)
    matrix, offset = weights[-1]
    out = seen @ matrix + offset
    return out[..., :9], out[..., 9]


def decide(weights: Any, carry: Any, key: Array) -> tuple[Any, Any]:
    """One decision in every world."""
    states, seen = carry
    choice, fresh = jax.random.split(key)
    preferences, value = judge(weights, seen)
    actions = jax.random.categorical(choice, preferences)
    chance = likelihood(preferences, actions)
    states, steps = jax.vmap(partial(functional.step, TASK))(states, actions)
    states, following = functional.restarted(TASK, states, steps, jax.random.split(fresh, WORLDS))
    future = jnp.where(steps.terminated, 0.0, judge(weights, steps.observation)[1])
    error = steps.reward + DISCOUNT * future - value
    goes_on = ~(steps.terminated | steps.truncated)
    return (states, following), (seen, actions, chance, value, error, goes_on)


def likelihood(preferences: Array, actions: Array) -> Array:
    """Logarithm of the probability of the actions taken."""
    every = jax.nn.log_softmax(preferences)
    return jnp.take_along_axis(every, actions[..., None], axis=-1)[..., 0]


def advantages(errors: Array, goes_on: Array) -> Array:
    """Generalised advantage estimation, backwards through [LENGTH, WORLDS]."""

    def back(later: Array, now: Any) -> tuple[Array, Array]:
        error, lasts = now
        found = error + DISCOUNT * TRACE * lasts * later
        return found, found

    return jax.lax.scan(back, jnp.zeros(WORLDS), (errors, goes_on), reverse=True)[1]


def loss(weights: Any, batch: Any) -> Array:
    """PPO's clipped objective."""
    seen, actions, chance, returns, advantage = batch
    preferences, value = judge(weights, seen)
    ratio = jnp.exp(likelihood(preferences, actions) - chance)
    scaled = (advantage - advantage.mean()) / (advantage.std() + 1e-8)
    clipped = jnp.minimum(ratio * scaled, jnp.clip(ratio, 1 - CLIP, 1 + CLIP) * scaled)
    every = jax.nn.log_softmax(preferences)
    entropy = -(jnp.exp(every) * every).sum(-1)
    return 0.5 * ((value - returns) ** 2).mean() - clipped.mean() - ENTROPY * entropy.mean()


def update(learner: Any, batch: Any) -> tuple[Any, None]:
    """One step of the optimiser."""
    weights, moments = learner
    change, moments = OPTIMISER.update(jax.grad(loss)(weights, batch), moments)
    return (optax.apply_updates(weights, change), moments), None


def iteration(carry: Any, key: Array) -> tuple[Any, None]:
    """Drive, then learn from it."""
    learner, worlds = carry
    drive, *shuffles = jax.random.split(key, 1 + EPOCHS)
    worlds, (seen, actions, chance, value, errors, goes_on) = jax.lax.scan(
        partial(decide, learner[0]), worlds, jax.random.split(drive, LENGTH)
    )
    advantage = advantages(errors, goes_on)
    gathered = (seen, actions, chance, value + advantage, advantage)
    flat = jax.tree.map(lambda leaf: leaf.reshape(WORLDS * LENGTH, *leaf.shape[2:]), gathered)
    for shuffle in shuffles:
        order = jax.random.permutation(shuffle, WORLDS * LENGTH).reshape(BATCHES, -1)
        batches = jax.tree.map(partial(jnp.take, indices=order, axis=0), flat)
        learner, _ = jax.lax.scan(update, learner, batches)
    return (learner, worlds), None


@partial(jax.jit, static_argnums=0)
def train(iterations: int, key: Array) -> Any:
    """The weights after so many iterations, in one call."""
    first, starts, rest = jax.random.split(key, 3)
    weights = network(first)
    states, shown = jax.vmap(partial(functional.reset, TASK))(jax.random.split(starts, WORLDS))
    carry = ((weights, OPTIMISER.init(weights)), (states, shown.observation))
    (learner, _), _ = jax.lax.scan(iteration, carry, jax.random.split(rest, iterations))
    return learner[0]


def main(steps: int = 300_000, seed: int = 0) -> tuple[Evaluation, Evaluation]:
    """Train for so many decisions, then test beside a random policy."""
    weights = train(max(1, steps // (WORLDS * LENGTH)), jax.random.key(seed))
    greedy = jax.jit(lambda seen: judge(weights, seen)[0].argmax(-1))
    chance = np.random.default_rng(seed)
    learnt = lanewise.evaluate(greedy, name="PPO in JAX")
    random = lanewise.evaluate(
        lambda seen: chance.integers(9, size=len(seen)), name="random", deterministic=False
    )
    print(learnt.table(random))
    return learnt, random


if __name__ == "__main__":
    tyro.cli(main)
