"""Stable-Baselines3's DQN on the trap with goals as actions: a planner drives to each goal.

The agent goes to `lanewise.evaluate` as it is, and gets out of the trap. It trains on episodes
longer than the test's 25 s, as our own trainings do.

python examples/sb3_dqn.py --steps 8000 --seed 0
"""

import gymnasium
import numpy as np
import torch
import tyro
from stable_baselines3 import DQN

import lanewise
from lanewise import Evaluation


def train(steps: int, seed: int) -> DQN:
    """An agent after so many goals."""
    torch.set_num_threads(1)  # networks this small only wait for one another in several
    agent = DQN(
        "MlpPolicy",
        gymnasium.make("lanewise/TrapGoal-v0", duration=60.0),
        learning_rate=1e-3,
        buffer_size=50_000,
        learning_starts=500,
        batch_size=64,
        train_freq=2,
        tau=0.01,
        target_update_interval=1,
        gamma=0.8,
        exploration_initial_eps=0.5,
        exploration_fraction=0.5,
        exploration_final_eps=0.02,
        policy_kwargs={"net_arch": [256, 256]},
        seed=seed,
        device="cpu",
    )
    return agent.learn(steps)


def main(steps: int = 8_000, seed: int = 0) -> tuple[Evaluation, Evaluation]:
    """Train, then test beside a random policy."""
    chance = np.random.default_rng(seed)
    learnt = lanewise.evaluate(train(steps, seed), name="SB3 DQN", actions="goal")
    random = lanewise.evaluate(
        lambda seen: chance.integers(9, size=len(seen)),
        name="random",
        actions="goal",
        deterministic=False,
    )
    print(learnt.table(random))
    return learnt, random


if __name__ == "__main__":
    tyro.cli(main)
