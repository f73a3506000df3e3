"""Measure how well our world equals highway-env: random states, free runs, live environments.

python benchmarks/parity.py --states 10000 --runs 1000 --default-runs 200 --linear-runs 200 \
    --configurations 330 --processes 2 --out results/parity/highway-env-1.12.1.json

What is done is kept beside the result file; the same command goes on from there. It exits with 1
where a state or a free run differs, or a difference in a live environment has no name.
"""

import argparse
import json
import os
import sys
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict
from functools import partial
from multiprocessing import get_context
from pathlib import Path

os.environ.setdefault("JAX_PLATFORMS", "cpu")
sys.path.insert(0, str(Path(__file__).parents[1] / "campaigns"))

import jax
import numpy as np
import record
from parity_compare import (
    CONTINUOUS,
    DECISIONS,
    RUN_TOLERANCE,
    STATE_TOLERANCE,
    agree,
    as_json,
    compare_states,
    largest,
    minimised,
)
from parity_drive import compare
from parity_environments import default_env, draw, linear_env, make
from parity_states import SIZES, paper_traffic, random_state

from lanewise.interop.highway_env import build_env
from lanewise.system.progress import Progress

BATCH = 40
"""Random states of one comparison: a batch shape for each size, compiled once."""
STATES_A_TASK = 6 * BATCH
RUN_SECONDS, RUN_ROOM, DEFAULT_ROOM = 25.0, 12, 51
"""Of a free run: simulated time, and vehicles of the programs of the two kinds of traffic."""
DEPENDS_ON = ("benchmarks", "src/lanewise/world", "src/lanewise/interop", "src/lanewise/scenario")
STORED_EXCEPTIONS = 10
"""Differences without a name that are stored; all are counted."""
DRAWN = ("action", "traffic", "road", "drivers")


def random_states(seed, number, seconds):
    """Compare ticks from random states; their batches are filled up by more states.

    Every other task has linear drivers among the others.
    """
    rng = np.random.default_rng([seed, 1, number])
    groups = {size: [] for size in SIZES}
    done, most, exceptions = 0, dict.fromkeys(CONTINUOUS, 0.0), []
    while done < STATES_A_TASK:
        world = random_state(rng, linear=number % 2 == 1)
        group = groups[world.vehicles.x.shape[0]]
        group.append(world)
        if len(group) < BATCH:
            continue
        for state, errors in zip(group, compare_states(group), strict=True):
            if agree(errors, STATE_TOLERANCE).all():
                most = {name: max(most[name], found) for name, found in largest(errors).items()}
            else:
                unequal = [name for name in DECISIONS if errors[name].any()]
                state = as_json(minimised(state))
                exceptions.append({"errors": largest(errors), "unequal": unequal, "state": state})
        done += BATCH
        group.clear()
    return {"compared": done, "largest_errors": most, "exceptions": exceptions}


def paper_run(seed, number, seconds):
    """Compare a free run of 25 s of the paper's traffic, at 10 Hz with 2 decisions a second."""
    rng = np.random.default_rng([seed, 2, number])
    env = build_env(paper_traffic(rng))
    env.action_space.seed(int(rng.integers(2**31)))
    return _free_run(env, number, RUN_ROOM)


def default_run(seed, number, seconds):
    """Compare a free run of 25 s of highway-env's own 50 vehicles, at 15 Hz."""
    rng = np.random.default_rng([seed, 3, number])
    return _free_run(default_env(int(rng.integers(2**31))), number, DEFAULT_ROOM)


def linear_run(seed, number, seconds, others=50):
    """Compare a free run of 25 s of linear drivers among highway-env's default ones, at 15 Hz.

    Some come to a standstill, where their steering is rounding times up to 4e5.
    """
    rng = np.random.default_rng([seed, 6, number])
    env = linear_env(int(rng.integers(2**31)), others)
    return _free_run(env, number, others + 1, allowed={"standstill-and-reversing"})


def _free_run(env, number, room, allowed=frozenset()):
    """A run in which no difference is allowed, not even one with another name."""
    found = compare(env, RUN_SECONDS, room)
    differs = set(found["names"]) - allowed or found["unexplained"]
    exceptions = [{"run": number} | found] if differs else []
    return {"compared": 1, "exceptions": exceptions, "largest_errors": found["largest_errors"]}


def live_environment(seed, number, seconds):
    """Compare a live environment, made as users make it."""
    configuration = draw(seed, number, seconds)
    return asdict(configuration) | compare(make(seed, configuration), seconds)


KINDS = {
    "random_states": (random_states, STATE_TOLERANCE),
    "paper_runs": (paper_run, RUN_TOLERANCE),
    "default_runs": (default_run, RUN_TOLERANCE),
    "linear_runs": (linear_run, RUN_TOLERANCE),
    "live_environments": (live_environment, RUN_TOLERANCE),
}
"""What is compared: the function that does one task, and the tolerance."""


def work(kind, seed, number, seconds):
    """One task, for a worker process."""
    with jax.enable_x64(True):
        return KINDS[kind][0](seed, number, seconds)


def summarise(kind, parts):
    """One kind's part of the result file."""
    errors = [part["largest_errors"] for part in parts]
    found = {
        "compared": sum(part.get("compared", 1) for part in parts),
        "tolerance": KINDS[kind][1],
        "largest_errors": {name: max(each[name] for each in errors) for name in CONTINUOUS},
    }
    if kind != "live_environments":
        return found | {"exceptions": [each for part in parts for each in part["exceptions"]]}
    unexplained = [
        {"number": row["number"]} | each | {"state": state}
        for row in parts
        for each, state in zip(row["unexplained"], row["states"], strict=False)
    ]
    return found | {
        "ticks": sum(row["ticks"] for row in parts),
        "vehicle_ticks": sum(row["ticks"] * (row["others"] + row["controlled"]) for row in parts),
        "without_any_difference": sum(row["ticks_equal"] == row["ticks"] for row in parts),
        "wreck_flags": sum(row["wreck_flags"] for row in parts),
        "named": named(parts),
        "drawn": {what: dict(Counter(row[what] for row in parts)) for what in DRAWN}
        | {"starts": dict(Counter(start for row in parts for start in row["starts"]))},
        "differences_without_a_name": sum(len(row["unexplained"]) for row in parts),
        "exceptions": unexplained[:STORED_EXCEPTIONS],
    }


def named(rows):
    """How often each name was given, in how many environments, and the first example."""
    found = {}
    for row in rows:
        for name, count in row["names"].items():
            example = {"number": row["number"]} | row["examples"][name]
            entry = found.setdefault(
                name, {"differences": 0, "configurations": 0, "example": example}
            )
            entry["differences"] += count
            entry["configurations"] += 1
    return dict(sorted(found.items()))


class Done:
    """The tasks that are done, kept in a file beside the result, a line each."""

    def __init__(self, path, state):
        """Read what the same campaign did before; anything else is forgotten."""
        self.path, self.parts = path, {}
        lines = path.read_text().splitlines() if path.exists() else []
        if lines and json.loads(lines[0]) == state:
            self.parts = {tuple(task): part for task, part in map(json.loads, lines[1:])}
            return
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(state) + "\n")

    def add(self, task, part):
        """Keep a task's part."""
        # As a later command would read it.
        line = json.dumps([task, part])
        self.parts[task] = json.loads(line)[1]
        with self.path.open("a") as file:
            file.write(line + "\n")


def faults(parts):
    """How many parts would fail the campaign."""
    return sum(bool(part.get("exceptions") or part.get("unexplained")) for part in parts)


def perform(tasks, done, processes, seconds):
    """Do the tasks that are not done yet."""
    left = [task for task in tasks if task not in done.parts]
    spawn = get_context("spawn")
    with ProcessPoolExecutor(processes, mp_context=spawn) as pool, Progress() as progress:
        progress.stage("parity with highway-env", len(tasks), len(tasks) - len(left))
        futures = {pool.submit(work, *task, seconds): task for task in left}
        for future in as_completed(futures):
            done.add(futures[future], future.result())
            progress.update(len(done.parts), faults=faults(done.parts.values()))


def main():
    """Run the campaign and store its result."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    count = partial(parser.add_argument, type=int)
    count("--states", default=10_000)
    count("--runs", default=1_000)
    count("--default-runs", default=200)
    count("--linear-runs", default=0)
    count("--configurations", default=330, help="of live environments")
    count("--seed", default=0)
    count("--processes", default=1)
    parser.add_argument("--seconds", type=float, default=40.0, help="of each live environment")
    parser.add_argument("--out", type=Path, default=Path("results/parity/highway-env-1.12.1.json"))
    options = parser.parse_args()
    states, runs = -(-options.states // STATES_A_TASK), (options.runs, options.default_runs)
    numbers = (states, *runs, options.linear_runs, options.configurations)
    numbers = dict(zip(KINDS, numbers, strict=True))
    tasks = [(kind, options.seed, n) for kind, number in numbers.items() for n in range(number)]
    state = record.state(
        options.seed, options.seconds, within=DEPENDS_ON, packages=("highway-env",)
    )
    done = Done(options.out.with_suffix(".partial"), state)
    begin = time.monotonic()
    perform(tasks, done, options.processes, options.seconds)
    figures = {
        kind: summarise(kind, [done.parts[task] for task in tasks if task[0] == kind])
        for kind, number in numbers.items()
        if number
    }
    more = {"simulated_seconds_each": options.seconds, "seconds": round(time.monotonic() - begin)}
    record.store(options.out, figures | more, options.seed, ("highway-env",))
    done.path.unlink()
    for kind, part in figures.items():
        print(kind, {name: part[name] for name in ("compared", "largest_errors")})
    return 1 if faults([done.parts[task] for task in tasks]) else 0


if __name__ == "__main__":
    sys.exit(main())
