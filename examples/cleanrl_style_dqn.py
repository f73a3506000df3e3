"""Double DQN in one file, in CleanRL's way, on 32 traps stepped by one compiled call.

`gymnasium.make_vec` gives Lanewise's own vector environment. In Gymnasium's default autoreset mode
an environment whose episode is over restarts with the *next* step. That step ignores its action
and gives no reward, so it stays out of the replay. The step before it returns the episode's true
last observation, and only ``terminated`` says that nothing follows.

python examples/cleanrl_style_dqn.py --steps 60000 --seed 0
"""

import copy

import gymnasium
import numpy as np
import torch
import tyro
from torch import nn

import lanewise
from lanewise import Evaluation

ENVIRONMENTS, CAPACITY, BATCH, WARM_UP = 32, 50_000, 128, 2_000
DISCOUNT, RATE, LEARNING_RATE = 0.8, 0.01, 5e-4
EPSILON = (0.5, 0.02)
"""At first, and from half of the training on."""


def train(steps: int, seed: int) -> nn.Module:
    """The network after so many decisions."""
    torch.manual_seed(seed)
    torch.set_num_threads(1)  # networks this small only wait for one another in several
    random = np.random.default_rng(seed)
    envs = gymnasium.make_vec("lanewise/Trap-v0", num_envs=ENVIRONMENTS)
    online = nn.Sequential(
        *(nn.Linear(26, 128), nn.ReLU(), nn.Linear(128, 128), nn.ReLU(), nn.Linear(128, 9))
    )
    target = copy.deepcopy(online)
    optimiser = torch.optim.Adam(online.parameters(), LEARNING_RATE)
    replay = Replay(CAPACITY)
    seen, _ = envs.reset(seed=seed)
    restarts = np.zeros(ENVIRONMENTS, bool)
    for step in range(0, steps, ENVIRONMENTS):
        with torch.no_grad():
            actions = online(torch.as_tensor(seen)).argmax(1).numpy()
        epsilon = np.interp(step, [0, steps / 2], EPSILON)
        explores = random.random(ENVIRONMENTS) < epsilon
        actions = np.where(explores, random.integers(9, size=ENVIRONMENTS), actions)
        following, rewards, terminated, truncated, _ = envs.step(actions)
        replay.add(~restarts, seen, actions, rewards, following, terminated)
        seen, restarts = following, terminated | truncated
        if replay.count > WARM_UP:
            for _ in range(ENVIRONMENTS // 8):
                learn(online, target, optimiser, replay.sample(random))
    envs.close()
    return online


def learn(
    online: nn.Module,
    target: nn.Module,
    optimiser: torch.optim.Optimizer,
    batch: list[torch.Tensor],
) -> None:
    """One update of double DQN; the target network follows slowly."""
    seen, actions, rewards, following, terminated = batch
    with torch.no_grad():
        best = online(following).argmax(1, keepdim=True)
        future = target(following).gather(1, best).squeeze(1)
        wanted = rewards + DISCOUNT * (1.0 - terminated) * future
    values = online(seen).gather(1, actions[:, None]).squeeze(1)
    optimiser.zero_grad()
    nn.functional.smooth_l1_loss(values, wanted).backward()
    optimiser.step()
    with torch.no_grad():
        for slow, fast in zip(target.parameters(), online.parameters(), strict=True):
            slow.lerp_(fast, RATE)


class Replay:
    """The last transitions, in a ring."""

    def __init__(self, capacity: int) -> None:
        shapes = (((26,), "f4"), ((), "i8"), ((), "f4"), ((26,), "f4"), ((), "f4"))
        self.rings = [np.zeros((capacity, *shape), dtype) for shape, dtype in shapes]
        self.capacity, self.count = capacity, 0

    def add(self, which: np.ndarray, *parts: np.ndarray) -> None:
        """Keep the transitions of some of the environments."""
        places = (self.count + np.arange(which.sum())) % self.capacity
        for ring, part in zip(self.rings, parts, strict=True):
            ring[places] = part[which]
        self.count += len(places)

    def sample(self, random: np.random.Generator) -> list[torch.Tensor]:
        """A batch, drawn evenly."""
        places = random.integers(min(self.count, self.capacity), size=BATCH)
        return [torch.as_tensor(ring[places]) for ring in self.rings]


def main(steps: int = 60_000, seed: int = 0) -> tuple[Evaluation, Evaluation]:
    """Train, then test beside a random policy."""
    agent, chance = train(steps, seed), np.random.default_rng(seed)
    learnt = lanewise.evaluate(
        lambda seen: agent(torch.as_tensor(seen)).argmax(1).numpy(), name="CleanRL-style DQN"
    )
    random = lanewise.evaluate(
        lambda seen: chance.integers(9, size=len(seen)), name="random", deterministic=False
    )
    print(learnt.table(random))
    return learnt, random


if __name__ == "__main__":
    tyro.cli(main)
