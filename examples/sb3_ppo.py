"""Stable-Baselines3's PPO on the trap with acceleration and steering as continuous actions.

`make_vec_env` wraps single environments, as Stable-Baselines3 has vector environments of its own.

python examples/sb3_ppo.py --steps 20000 --seed 0
"""

import numpy as np
import torch
import tyro
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env

import lanewise
from lanewise import Evaluation


def train(steps: int, seed: int) -> PPO:
    """An agent after so many decisions."""
    torch.set_num_threads(1)  # networks this small only wait for one another in several
    agent = PPO(
        "MlpPolicy",
        make_vec_env("lanewise/TrapContinuous-v0", n_envs=8, seed=seed),
        learning_rate=1e-3,
        n_steps=128,
        batch_size=128,
        gamma=0.95,
        policy_kwargs={"log_std_init": -1.0},
        seed=seed,
        device="cpu",
    )
    return agent.learn(steps)


def main(steps: int = 20_000, seed: int = 0) -> tuple[Evaluation, Evaluation]:
    """Train, then test beside a random policy."""
    chance = np.random.default_rng(seed)
    learnt = lanewise.evaluate(train(steps, seed), name="SB3 PPO", actions="continuous")
    random = lanewise.evaluate(
        lambda seen: chance.uniform(-1, 1, (len(seen), 2)),
        name="random",
        actions="continuous",
        deterministic=False,
    )
    print(learnt.table(random))
    return learnt, random


if __name__ == "__main__":
    tyro.cli(main)
