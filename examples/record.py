"""Train one of the examples from several seeds and store its tests as a row of the results table.

python examples/record.py sb3_dqn --steps 50000 --seeds 0 1 2 --out results/outside/sb3-dqn.json
"""

import importlib
import json
import shlex
import sys
import time
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Literal

import tyro

from lanewise.report import files, provenance

TITLES = {
    "sb3_dqn": "Stable-Baselines3's DQN, goals",
    "sb3_ppo": "Stable-Baselines3's PPO, continuous actions",
    "cleanrl_style_dqn": "Double DQN in CleanRL's style, flat",
    "tianshou_double_dqn": "Tianshou's double DQN, goals",
    "jax_loop": "PPO in plain JAX, flat",
}
LIBRARIES = {
    "sb3_dqn": ("stable-baselines3", "torch"),
    "sb3_ppo": ("stable-baselines3", "torch"),
    "cleanrl_style_dqn": ("torch",),
    "tianshou_double_dqn": ("tianshou", "torch"),
    "jax_loop": (),
}


def main(
    example: tyro.conf.Positional[Literal[tuple(TITLES)]],
    /,
    steps: int,
    out: Path,
    seeds: tuple[int, ...] = (0,),
) -> None:
    """Train and test from each seed; write ``out`` once all are done."""
    module = importlib.import_module(example)
    rows = []
    for seed in seeds:
        begun = time.monotonic()
        learnt, random = module.main(steps, seed)
        rows.append(
            {
                "seed": seed,
                "learnt": learnt.summary.to_json(),
                "random": random.summary.to_json(),
                "seconds": round(time.monotonic() - begun, 1),
            }
        )
    stored = {
        "title": TITLES[example],
        "example": example,
        "command": f"python examples/record.py {shlex.join(sys.argv[1:])}",
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "versions": provenance.versions() | {name: version(name) for name in LIBRARIES[example]},
        "machine": provenance.machine(),
        "steps": steps,
        "seeds": rows,
    }
    out.parent.mkdir(parents=True, exist_ok=True)
    files.write_text(out, json.dumps(stored, indent=1) + "\n")


if __name__ == "__main__":
    tyro.cli(main)
