"""Stable-Baselines3's DQN, with the network, batch, replay and step size of our training.

It is not a double DQN: it makes two forward passes an update where ours makes three.
"""

import os
import time

import gymnasium
import numpy as np
import timing
import torch
from stable_baselines3 import DQN
from stable_baselines3.common.logger import configure

CALL = 100
"""Updates, or steps, in a call of Stable-Baselines3."""


def _agent(env, seed, hidden, batch, capacity, learning_rate, discount, **more):
    torch.set_num_threads(len(os.sched_getaffinity(0)))
    return DQN(
        "MlpPolicy",
        env,
        policy_kwargs={"net_arch": hidden},
        batch_size=batch,
        buffer_size=capacity,
        learning_rate=learning_rate,
        gamma=discount,
        seed=seed,
        device="cpu",
        **more,
    )


class _Nothing(gymnasium.Env):
    """Spaces without a world."""

    def __init__(self, inputs, outputs):
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (inputs,))
        self.action_space = gymnasium.spaces.Discrete(outputs)


def update(inputs, outputs, seconds, seed=0, **learner):
    """Updates/s, sampling from a filled replay included. Needs only Stable-Baselines3."""
    model = _agent(_Nothing(inputs, outputs), seed, **learner)
    model.set_logger(configure(None, []))
    random, memory = np.random.default_rng(seed), model.replay_buffer
    memory.observations[:] = random.normal(size=memory.observations.shape)
    memory.next_observations[:] = random.normal(size=memory.observations.shape)
    memory.actions[:] = random.integers(0, outputs, memory.actions.shape)
    memory.rewards[:] = random.normal(size=memory.rewards.shape)
    memory.full = True

    def call():
        model.train(gradient_steps=CALL, batch_size=learner["batch"])

    call()
    return lambda: timing.result(timing.calls_per_second(call, seconds) * CALL, "updates/s")


class _Trap(gymnasium.Env):
    """The trap in the real highway-env, with its own observation and a reward for speed."""

    def __init__(self, vehicles, lanes, seed):
        # Lanewise is not needed, and may not be installed, for `update`.
        import peer_highway_env

        self._starts = peer_highway_env.Starts(vehicles, lanes, seed)
        self._episode, self._env = 0, None
        self.observation_space = gymnasium.spaces.Box(-1.0, 1.0, (25,))
        self.action_space = gymnasium.spaces.Discrete(9)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self._env = self._starts.env(self._episode)
        self._episode += 1
        return self._flat(self._env.observation_type.observe()), {}

    def step(self, action):
        observed, _, _, truncated, _ = self._env.step(int(action))
        accident = bool(self._starts.accident(self._env))
        speed = (self._env.vehicle.speed - 5.0) / 10.0
        reward = -10.0 if accident else float(np.clip(speed, 0.0, 1.0))
        return self._flat(observed), reward, accident, bool(truncated), {}

    @staticmethod
    def _flat(table):
        return np.asarray(table, np.float32).ravel()


class _Clock:
    """Adds up the time spent in a function."""

    def __init__(self, function):
        self._function, self.seconds, self.calls = function, 0.0, 0

    def __call__(self, *arguments, **named):
        began = time.perf_counter()
        found = self._function(*arguments, **named)
        self.seconds += time.perf_counter() - began
        self.calls += 1
        return found


def training(vehicles, lanes, seconds, seed=0, **learner):
    """Environment steps/s on the trap in highway-env, an update every step; needs Lanewise too."""
    trap = _Trap(vehicles, lanes, seed)
    model = _agent(
        trap, seed, **learner, learning_starts=100, train_freq=1, gradient_steps=1,
        # Exploration without end, however often `learn` is called.
        exploration_final_eps=1.0,
    )  # fmt: skip
    model.learn(110)

    def timed():
        trap.step, model.train = stepping, learning = _Clock(trap.step), _Clock(model.train)

        def call():
            model.learn(CALL, reset_num_timesteps=False)

        rate = timing.calls_per_second(call, seconds) * CALL
        split = {
            "driving": stepping.seconds / stepping.calls,
            "updates": learning.seconds / learning.calls,
        }
        split["host"] = 1 / rate - sum(split.values())
        return timing.result(
            rate,
            "steps/s",
            updates_per_second=rate * learning.calls / stepping.calls,
            milliseconds_a_step={name: value * 1e3 for name, value in split.items()},
        )

    return timed
