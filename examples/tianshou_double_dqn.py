"""Tianshou's double DQN on the trap with goals as actions: a planner drives to each goal.

Tianshou collects from vector environments of its own, made of single ones. Training episodes are
longer than the test's 25 s, as our own trainings do. Its collector explores only if told to.

python examples/tianshou_double_dqn.py --steps 12000 --seed 0
"""

import gymnasium
import numpy as np
import torch
import tyro
from tianshou.algorithm import DQN
from tianshou.algorithm.modelfree.dqn import DiscreteQLearningPolicy
from tianshou.algorithm.optim import AdamOptimizerFactory
from tianshou.data import Batch, Collector, VectorReplayBuffer
from tianshou.env import DummyVectorEnv
from tianshou.trainer import OffPolicyTrainerParams
from tianshou.utils.net.common import Net

import lanewise
from lanewise import Evaluation

ENVIRONMENTS = 8


def train(steps: int, seed: int) -> DiscreteQLearningPolicy:
    """The policy after so many goals."""
    torch.manual_seed(seed)
    np.random.seed(seed)  # Tianshou explores with it
    torch.set_num_threads(1)  # networks this small only wait for one another in several
    envs = DummyVectorEnv(
        [lambda: gymnasium.make("lanewise/TrapGoal-v0", duration=60.0)] * ENVIRONMENTS
    )
    envs.seed(seed)
    policy = DiscreteQLearningPolicy(
        model=Net(state_shape=26, action_shape=9, hidden_sizes=[256, 256]),
        action_space=gymnasium.spaces.Discrete(9),
    )
    algorithm = DQN(
        policy=policy,
        optim=AdamOptimizerFactory(lr=1e-3),
        gamma=0.8,
        target_update_freq=100,
        is_double=True,
        huber_loss_delta=1.0,
    )
    replay = VectorReplayBuffer(50_000, ENVIRONMENTS)
    collector = Collector(policy, envs, replay, exploration_noise=True)
    collector.reset()
    algorithm.run_training(
        OffPolicyTrainerParams(
            training_collector=collector,
            max_epochs=1,
            epoch_num_steps=steps,
            collection_step_num_env_steps=8 * ENVIRONMENTS,
            update_step_num_gradient_steps_per_sample=0.5,
            training_fn=lambda _, done: policy.set_eps_training(
                float(np.interp(done, [0, steps / 2], [0.5, 0.02]))
            ),
            show_progress=False,
            verbose=False,
        )
    )
    return policy


def main(steps: int = 12_000, seed: int = 0) -> tuple[Evaluation, Evaluation]:
    """Train, then test beside a random policy."""
    policy, chance = train(steps, seed), np.random.default_rng(seed)
    learnt = lanewise.evaluate(
        lambda seen: policy(Batch(obs=seen, info={})).act, name="Tianshou", actions="goal"
    )
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
