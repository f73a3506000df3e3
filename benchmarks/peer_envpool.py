"""EnvPool's highway-env in C++ under random meta-actions. Needs only EnvPool and NumPy."""

import envpool
import numpy as np
import timing


def world(task, envs, threads, seconds, settings, seed=0):
    """Vehicle-ticks/s of a pool whose environments are all stepped in each call."""
    pool = envpool.make_gymnasium(task, num_envs=envs, num_threads=threads, seed=seed, **settings)
    config = pool.spec.config
    # Drawn before, so that the time is the pool's.
    drawn = np.random.default_rng(seed).integers(0, pool.action_space.n, (1000, envs))
    steps, ended = 0, {}
    pool.reset()

    def step():
        nonlocal steps
        _, _, terminated, truncated, _ = pool.step(drawn[steps % len(drawn)])
        steps += 1
        ended["collision"] += int(terminated.sum())
        ended["truncated"] += int((truncated & ~terminated).sum())

    def timed(seconds=seconds):
        ended.update(collision=0, truncated=0)
        rate = timing.calls_per_second(step, seconds) * envs
        ticks = config.simulation_frequency // config.policy_frequency
        return timing.driving(rate, config.vehicles_count + 1, ticks, ended)

    timed(0.2)
    return timed
