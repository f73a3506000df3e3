"""For users of highway-env: the loop they know, in the real highway-env and in ours.

`lanewise/TrapHighwayEnv-v0` is the trap in the real highway-env, `lanewise/Trap-v0` the same trap
compiled. The same seed is the same start in both; the same actions earn the same rewards, up to the
rounding of 32-bit numbers. So train in the fast one, and test in the real one.

python examples/highway_env_quick_start.py --steps 100 --seed 0
"""

import gymnasium
import numpy as np
import tyro

import lanewise
from lanewise import Evaluation


def drive(name: str, steps: int, seed: int) -> list[float]:
    """The rewards of so many decisions, the same ones in every environment."""
    env = gymnasium.make(name)
    env.action_space.seed(seed)
    env.reset(seed=seed)
    rewards = []
    for _ in range(steps):
        _, reward, terminated, truncated, _ = env.step(env.action_space.sample())
        rewards.append(float(reward))
        if terminated or truncated:
            env.reset()
    env.close()
    return rewards


def main(steps: int = 100, seed: int = 0) -> tuple[Evaluation, Evaluation]:
    """Drive in both, then test in the real one: a trained controller beside a random policy."""
    there = drive("lanewise/TrapHighwayEnv-v0", steps, seed)
    here = drive("lanewise/Trap-v0", steps, seed)
    print(f"rewards of {steps} decisions: {sum(there):.4f} in highway-env, {sum(here):.4f} here")
    print(f"largest difference of one: {np.abs(np.subtract(there, here)).max():.1e}\n")
    chance = np.random.default_rng(seed)
    tests = {"world": "highway-env", "episodes": 20}
    trained = lanewise.evaluate("pretrained/hierarchical", **tests)
    random = lanewise.evaluate(
        lambda seen: chance.integers(9, size=len(seen)),
        name="random",
        deterministic=False,
        **tests,
    )
    print(trained.table(random))
    return trained, random


if __name__ == "__main__":
    tyro.cli(main)
