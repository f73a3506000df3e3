"""Train and test many runs through the command line, and store what came out.

    python benchmarks/study.py quick --seeds 10 --highway-env 100 --out results/quick.json
    python benchmarks/study.py readings --seeds 3 --out results/readings.json

Every run is a ``lanewise train`` in a folder under ``--work``; finished ones are kept, stopped
ones resumed, so the study can be interrupted. Weights are chosen on validation starts inside the
training; the test starts are driven once, here.
"""

import argparse
import json
import os
import shlex
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from statistics import mean

from lanewise.report.provenance import machine, versions

BINARY = [sys.executable, "-m", "lanewise"]

EXPONENTIAL = {
    f"{stage}.exploration.{name}": value
    for stage in ("high_level", "low_level")
    for name, value in (("schedule", "exponential"), ("steps", "1000"))
}

READINGS = {
    "default": {},
    "row 10: highway-env's scaling": {"driving.observation.scaling": "highway-env"},
    "row 14: gamma^k, 0.8 a decision": {"high_level.discount_across_goal": "per-decision"},
    "row 15: exponential epsilon over 1000 steps": EXPONENTIAL,
    "row 21: external reward only": {"low_level.tracking_weight": "0"},
    "row 22a: goal held by the critic in step 2": {"goals.training_renewal": "critic"},
    "row 22b: goal held by the critic in tests": {"goals.test_renewal": "critic"},
    "row 22a+b: held by the critic in both": {
        "goals.training_renewal": "critic",
        "goals.test_renewal": "critic",
    },
    "row 22c: new goal relative to the current state": {"goals.reference": "current-state"},
}
"""The literal alternatives beside the default, as settings."""

SAME_STEP_1 = ("row 21", "row 22a", "row 22b")
"""Arms that differ in step 2 or in tests alone take over the default's high level."""


@dataclass(frozen=True)
class Run:
    """One training and its tests."""

    arm: str
    controller: str
    seed: int
    changes: dict[str, str]
    path: Path
    high_level: Path | None


def main() -> None:
    """Run the study named on the command line."""
    options = _options()
    runs = _runs(options)
    first = [run for run in runs if run.high_level is None]
    rest = [run for run in runs if run.high_level is not None]
    rows = []
    with ThreadPoolExecutor(options.processes) as pool:
        for group in (first, rest):
            for row in pool.map(lambda run: _one(run, options), group):
                rows.append(row)
                _store(options, rows)
    for arm in dict.fromkeys(row["arm"] for row in rows):
        group = [row["lanewise"] for row in rows if row["arm"] == arm]
        print(f"{arm}: " + _line(group))


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("study", choices=("quick", "readings"))
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--controllers", nargs="+", default=["hierarchical"])
    parser.add_argument("--episodes", type=int, default=300)
    parser.add_argument("--highway-env", type=int, default=0, help="episodes there, 0 for none")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--work", type=Path, default=Path("runs/study"))
    parser.add_argument("--out", type=Path, required=True)
    return parser.parse_args()


def _runs(options: argparse.Namespace) -> list[Run]:
    arms = READINGS if options.study == "readings" else {"default": {}}
    runs = []
    for seed in range(options.first_seed, options.first_seed + options.seeds):
        for controller in options.controllers:
            for arm, changes in arms.items():
                name = "".join(c if c.isalnum() else "-" for c in arm.split(":")[0])
                folder = options.work / f"{controller}-{name}-{seed}"
                default = options.work / f"{controller}-default-{seed}"
                shares = arm.startswith(SAME_STEP_1)
                runs.append(
                    Run(arm, controller, seed, changes, folder, default if shares else None)
                )
    return runs


def _one(run: Run, options: argparse.Namespace) -> dict[str, object]:
    """Train, or continue, then test; the row to store."""
    began = time.monotonic()
    if not (run.path / "controller.json").exists():
        _call(_train_command(run))
    seconds = time.monotonic() - began
    test_seed = str(run.seed)
    evaluate = [*BINARY, "evaluate", str(run.path), "--seed", test_seed, "--json"]
    row: dict[str, object] = {
        "arm": run.arm,
        "controller": run.controller,
        "seed": run.seed,
        "changes": run.changes,
        "train_seconds": round(seconds, 1),
    }
    ours = run.path / "lanewise.csv"
    out = ["--episodes", str(options.episodes), "--episodes-out", str(ours)]
    row["lanewise"] = json.loads(_call([*evaluate, *out]))
    if options.highway_env:
        theirs = run.path / "highway-env.csv"
        stored = run.path / "highway-env.json"
        if not stored.exists():
            out = ["--episodes", str(options.highway_env), "--episodes-out", str(theirs)]
            stored.write_text(_call([*evaluate, "--world", "highway-env", *out]))
        row["highway_env"] = json.loads(stored.read_text())
        row["differing"] = _differing(ours, theirs)
    print(f"{run.arm}, seed {run.seed}: {_line([row['lanewise']])}", flush=True)
    return row


def _train_command(run: Run) -> list[str]:
    command = [*BINARY, "train", run.controller, "--seed", str(run.seed), "--out", str(run.path)]
    if run.high_level is not None:
        command += ["--high-level", str(run.high_level)]
    for name, value in run.changes.items():
        command += [f"--{name.replace('_', '-')}", value]
    return [*command, "--resume"] if (run.path / "run.json").exists() else command


def _call(command: list[str]) -> str:
    flags = f"{os.environ.get('XLA_FLAGS', '')} --xla_cpu_multi_thread_eigen=false".strip()
    done = subprocess.run(
        command, env=os.environ | {"XLA_FLAGS": flags}, capture_output=True, text=True
    )
    if done.returncode:
        raise SystemExit(f"{shlex.join(command)}\n{done.stderr}")
    return done.stdout


def _differing(ours: Path, theirs: Path) -> list[dict[str, str]]:
    """Starts that end otherwise in highway-env: success or accident differ."""
    mine, other = ([line.split(",") for line in p.read_text().splitlines()] for p in (ours, theirs))
    head = mine[0]
    keys = [head.index("success"), head.index("accident")]
    return [
        {"episode": str(i), "lanewise": ",".join(a), "highway_env": ",".join(b)}
        for i, (a, b) in enumerate(zip(mine[1:], other[1:], strict=False))
        if [a[k] for k in keys] != [b[k] for k in keys]
    ]


def _line(group: list[dict[str, float]]) -> str:
    names = ("success_rate", "accident_rate", "accumulated_reward", "average_speed")
    return ", ".join(
        f"{name.replace('_', ' ')} {mean(row[name] for row in group):.4g}"
        for name in (*names, "travel_distance")
    )


def _store(options: argparse.Namespace, rows: list[dict[str, object]]) -> None:
    options.out.parent.mkdir(parents=True, exist_ok=True)
    stored = {
        "command": shlex.join(["python", *sys.argv]),
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "versions": versions(),
        "machine": machine(),
        "rows": rows,
    }
    options.out.write_text(json.dumps(stored, indent=1) + "\n")


if __name__ == "__main__":
    main()
