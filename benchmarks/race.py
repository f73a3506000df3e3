"""Search settings for the flat controller and h-DQN, with as many runs as the hierarchical one had.

    python benchmarks/race.py --out race

The hierarchical controller's settings were chosen in 37 trainings (`results/search.json`, without
those of h-DQN and of preset `ranges`). Here each of the two others gets as many: 25 settings with
one seed, the defaults and 24 drawn from `SPACES`; then the best four with three seeds more. All
have the budget of preset `quick`. What counts is the score of the kept weights on 1,000 validation
starts by which no weights were chosen; the test start is not looked at. The same command continues
what was stopped. `race/race.json` holds every training.
"""

import argparse
import json
import os
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime
from pathlib import Path
from threading import Lock

import numpy as np

from lanewise import cores
from lanewise.evaluation.concurrent import ONE_THREAD
from lanewise.report import provenance
from lanewise.runs import metrics
from lanewise.training import selection

SPACES = {
    "single-level": {
        "single_level.hold": (1, 2, 3, 5, 8),
        "single_level.learner.discount": (0.8, 0.9, 0.95, 0.97, 0.99),
        "single_level.returns": (1, 3, 5),
        "single_level.updates_per_step": (0.125, 0.25, 0.5),
        "single_level.duration": (60, 120, 250),
    },
    "h-dqn": {
        "goals.time_limit": (2.0, 3.0, 4.0, 6.0),
        "h_dqn.high_level.learner.discount": (0.8, 0.9, 0.95),
        "h_dqn.low_level.learner.discount": (0.8, 0.9, 0.95, 0.99),
        "h_dqn.low_level.returns": (1, 3),
        "h_dqn.high_level.updates_per_step": (0.0625, 0.125, 0.25),
        "h_dqn.low_level.updates_per_step": (0.125, 0.25, 0.5),
        "h_dqn.duration": (60, 120, 250),
    },
}
"""By controller, the settings that are searched, and their values."""
DRAWN, BEST, MORE_SEEDS = 24, 4, (1, 2, 3)


def main() -> None:
    """Race both controllers and write down every training."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--controllers", nargs="+", choices=SPACES, default=list(SPACES))
    parser.add_argument("--processes", type=int, default=len(cores.usable()))
    options = parser.parse_args()
    for controller in options.controllers:
        first = [(number, changes, 0) for number, changes in enumerate(settings_of(controller))]
        race(options, controller, first)
        ranked = sorted(first, key=lambda one: -score(figures(folder(options, controller, *one))))
        again = [(*one[:2], seed) for one in ranked[:BEST] for seed in MORE_SEEDS]
        race(options, controller, again)


def settings_of(controller: str) -> list[dict[str, object]]:
    """What is tried: the defaults, and settings drawn without repetition, always the same ones."""
    rng, space = np.random.default_rng(0), SPACES[controller]
    found: list[dict[str, object]] = [{}]
    while len(found) <= DRAWN:
        changes = {name: values[rng.integers(len(values))] for name, values in space.items()}
        if changes not in found:
            found.append(changes)
    return found


def folder(options: argparse.Namespace, controller: str, number: int, _: object, seed: int) -> Path:
    """Where a training lies."""
    return options.out / controller / f"{number:02d}" / f"seed-{seed}"


def race(options: argparse.Namespace, controller: str, runs: list[tuple]) -> None:
    """Train what is left, as many at once as there are cores; the record grows with each."""

    writing = Lock()

    def one(run: tuple) -> None:
        number, changes, seed = run
        path = folder(options, controller, *run)
        if not (path / "controller.json").exists():
            train(controller, changes, seed, path)
        with writing:
            write(options.out)
        done = figures(path)
        sys.stderr.write(
            f"{controller} {number:02d}, seed {seed}: success {done['kept_success_rate']:.1%}, "
            f"accidents {done['kept_accident_rate']:.1%}, reward {done['kept_reward']:.2f}\n"
        )

    with ThreadPoolExecutor(options.processes) as pool:
        list(pool.map(one, runs))


def train(controller: str, changes: dict[str, object], seed: int, path: Path) -> None:
    """One training, or the rest of it, in a process of its own."""
    flags = [f"--{name.replace('_', '-')}={value}" for name, value in changes.items()]
    words = ["train", controller, "--out", str(path)]
    words += ["--resume"] if (path / "run.json").exists() else ["--seed", str(seed), *flags]
    environment = os.environ | {"XLA_FLAGS": f"{os.environ.get('XLA_FLAGS', '')} {ONE_THREAD}"}
    path.parent.mkdir(parents=True, exist_ok=True)
    began = time.monotonic()
    with open(f"{path}.log", "a") as log:
        command = [sys.executable, "-m", "lanewise", *words]
        subprocess.run(command, env=environment, stdout=log, stderr=log, check=True)
    with open(f"{path}.log", "a") as log:
        log.write(f"seconds {time.monotonic() - began:.1f}\n")


def figures(path: Path) -> dict[str, object]:
    """How the weights that a finished training kept do on fresh validation starts."""
    lines = metrics.read(path / "metrics.jsonl")
    return next(line for line in reversed(lines) if line["kind"] == "weights")


def score(figures: dict[str, object]) -> float:
    """Of the kept weights, as training chooses between its own."""
    names = ("success_rate", "accident_rate", "reward")
    return selection.weighed(*(figures[f"kept_{name}"] for name in names))


def write(out: Path) -> None:
    """The record of every training that is finished."""
    rows = []
    for path in sorted(out.glob("*/*/seed-*/controller.json")):
        controller, number, seed = path.parts[-4:-1]
        changes = settings_of(controller)[int(number)]
        found = figures(path.parent)
        rows.append(
            {
                "controller": controller,
                "number": int(number),
                "changes": changes,
                "seed": int(seed.removeprefix("seed-")),
                "score": score(found),
                **{name: found[name] for name in found if name.startswith(("kept_", "last_"))},
            }
        )
    record = {
        "what": "Settings of the flat controller and of h-DQN, searched as long as those of the "
        "hierarchical one: benchmarks/race.py says how.",
        "command": f"python benchmarks/race.py --out {out}",
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        **provenance.source(),
        "versions": provenance.versions(),
        "machine": provenance.machine(),
        "spaces": SPACES,
        "rows": rows,
    }
    beside = out / "race.json.part"
    beside.write_text(json.dumps(record, indent=1) + "\n")
    beside.replace(out / "race.json")


if __name__ == "__main__":
    main()
