"""Train an example from several seeds and store its tests, from which the tables are made.

python examples/record.py sb3_dqn --steps 60000 --seeds 0 1 2 --out results/outside/sb3-dqn.json
"""

import importlib
import inspect
import json
import shlex
import sys
import time
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import tyro

from lanewise.fields.suggestions import look_up
from lanewise.report import output_files, provenance

SB3 = ("stable-baselines3", "torch")
EXAMPLES = {
    "sb3_dqn": ("Stable-Baselines3's DQN, goals", "goals", SB3),
    "sb3_ppo": ("Stable-Baselines3's PPO, continuous", "decisions", SB3),
    "cleanrl_style_dqn": ("double DQN in CleanRL's way, flat", "decisions", ("torch",)),
    "tianshou_double_dqn": ("Tianshou's double DQN, goals", "goals", ("tianshou", "torch")),
    "jax_loop": ("PPO in plain JAX, flat", "decisions", ("jax", "optax")),
}
"""By file: title, what its steps are, packages that learn."""


def main(
    example: tyro.conf.Positional[str],
    out: Path,
    steps: int | None = None,
    seeds: tuple[int, ...] = (0,),
) -> None:
    """Train and test from each seed, and write ``out`` once all are done.

    Args:
        example: name of its file, without ``.py``.
        out: the JSON file.
        steps: goals or decisions of a training; by default the example's own few.
        seeds: of the trainings.
    """
    title, unit, learner = look_up("example", example, EXAMPLES)
    module = importlib.import_module(example)
    given = steps or inspect.signature(module.main).parameters["steps"].default
    rows = [_row(module, given, seed) for seed in seeds]
    stored = {
        "title": title,
        "example": example,
        "command": f"python examples/record.py {shlex.join(sys.argv[1:])}",
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "versions": provenance.versions() | {name: version(name) for name in learner},
        "learner": list(learner),
        **provenance.source(),
        "machine": provenance.machine(),
        "steps": given,
        "unit": unit,
        "seeds": rows,
    }
    out.parent.mkdir(parents=True, exist_ok=True)
    output_files.write_text(out, json.dumps(stored, indent=1) + "\n")


def _row(module: Any, steps: int, seed: int) -> dict[str, Any]:
    """One training and its tests."""
    begun = time.monotonic()
    learnt, random = module.main(steps, seed)
    return {
        "seed": seed,
        "learnt": learnt.summary.to_json(),
        "random": random.summary.to_json(),
        "seconds": round(time.monotonic() - begun, 1),
    }


if __name__ == "__main__":
    tyro.cli(main)
