"""Measure how well our world equals highway-env: random states, free runs, live environments.

python benchmarks/parity.py --states 10000 --runs 1000 --default-runs 200 --configurations 340 \
    --processes 2 --out results/parity/highway-env-1.12.1.json

What is done is kept beside the result file; the same command goes on from there. It exits with 1
where a difference has no name, or `read_world` reads or refuses what it should not.
"""

import argparse
import json
import os
import sys
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import partial
from multiprocessing import get_context
from pathlib import Path

os.environ.setdefault("JAX_PLATFORMS", "cpu")
sys.path.insert(0, str(Path(__file__).parents[1] / "campaigns"))

import jax
import numpy as np
import parity_live
import record
from parity_compare import (
    CONTINUOUS,
    RUN_TOLERANCE,
    STATE_TOLERANCE,
    agrees,
    as_json,
    compare_runs,
    compare_states,
    default_env,
    minimised,
)
from parity_environments import draw, seconds_of
from parity_states import SIZES, paper_traffic, random_state

from lanewise.interop.highway_env import build_env, read_world
from lanewise.system.progress import Progress

STATES_A_TASK, RUNS_A_TASK, DEFAULT_RUNS_A_TASK = 240, 20, 4
BATCH = 40
"""One batch shape per size, so that each process compiles two ticks and two runs."""
DEPENDS_ON = ("benchmarks", "src/lanewise/world", "src/lanewise/interop")
STORED_EXCEPTIONS = 10
"""Differences without a name that are stored; all are counted."""
COLUMNS = (
    "number",
    "rate",
    "lanes",
    "others",
    "controlled",
    "ticks",
    "ticks_equal",
    "largest",
    "wreck_flags",
)
"""Stored of every configuration that was compared; its number and the seed make it again."""

SHOWN = (
    "compared",
    "largest_errors",
    "largest_error_while_equal",
    "without_any_difference",
    "differences_without_a_name",
    "wrongly_read_or_refused",
)
"""Printed of each kind."""


def random_states(seed, task, count):
    """Compare ticks from random states; numbers of batches are padded by more states."""
    rng = np.random.default_rng([seed, 1, task])
    groups = {size: [] for size in SIZES}
    done, largest, exceptions = 0, dict.fromkeys(CONTINUOUS, 0.0), []
    while done < count:
        world = random_state(rng)
        group = groups[world.vehicles.x.shape[0]]
        group.append(world)
        if len(group) < BATCH:
            continue
        for state, (errors, unequal) in zip(group, compare_states(group), strict=True):
            if agrees(errors, unequal, STATE_TOLERANCE):
                largest = {name: max(largest[name], errors[name]) for name in CONTINUOUS}
            else:
                small = as_json(minimised(state))
                exceptions.append({"errors": errors, "unequal": unequal, "state": small})
        done += BATCH
        group.clear()
    return {"compared": done, "largest": largest, "exceptions": exceptions}


def _runs(envs, worlds, actions, first):
    largest, exceptions = dict.fromkeys(CONTINUOUS, 0.0), []
    for index, result in enumerate(compare_runs(envs, worlds, actions)):
        agreed, errors, unequal = result
        largest = {name: max(largest[name], errors[name]) for name in CONTINUOUS}
        if agreed < actions.shape[1]:
            start = as_json(worlds[index])
            exceptions.append(
                {
                    "run": first + index,
                    "decisions_equal": agreed,
                    "unequal": unequal,
                    "start": start,
                    "actions": actions[index].tolist(),
                }
            )
    return {"compared": len(envs), "largest": largest, "exceptions": exceptions}


def paper_runs(seed, task, count):
    """Compare free runs of 25 s of the paper's traffic, at 10 Hz with 2 decisions a second."""
    rng = np.random.default_rng([seed, 2, task])
    worlds = [paper_traffic(rng) for _ in range(count)]
    actions = rng.integers(0, 9, (count, 50))
    return _runs([build_env(world) for world in worlds], worlds, actions, task * RUNS_A_TASK)


def default_runs(seed, task, count):
    """Compare free runs of 25 s of highway-env's own 50 vehicles, at 15 Hz."""
    rng = np.random.default_rng([seed, 3, task])
    envs = [default_env(int(rng.integers(2**31))) for _ in range(count)]
    actions = rng.integers(0, 9, (count, 25))
    worlds = [read_world(env) for env in envs]
    return _runs(envs, worlds, actions, task * DEFAULT_RUNS_A_TASK)


KINDS = {
    "random_states": (random_states, STATES_A_TASK, STATE_TOLERANCE, 6.0),
    "paper_runs": (paper_runs, RUNS_A_TASK, RUN_TOLERANCE, 12.0),
    "default_runs": (default_runs, DEFAULT_RUNS_A_TASK, RUN_TOLERANCE, 16.0),
}
"""What each compares: function, how many a task, tolerance, about how long a task takes, s."""
LIVE = "live_environments"


def work(kind, seed, task, seconds):
    """One task, for a worker process."""
    with jax.enable_x64(True):
        if kind == LIVE:
            return parity_live.compare(seed, task, seconds)
        function, count, *_ = KINDS[kind]
        return function(seed, task, count)


def expected_seconds(kind, seed, task, seconds):
    """About how long a task takes on one core."""
    if kind != LIVE:
        return KINDS[kind][3]
    drawn = draw(seed, task, seconds)
    if drawn.unread is not None:
        return 0.1
    return seconds_of(drawn.rate, drawn.others + drawn.controlled, seconds)


def summarise(kind, parts):
    """One kind's part of the result file."""
    largest = {name: max(part["largest"][name] for part in parts) for name in CONTINUOUS}
    return {
        "compared": sum(part["compared"] for part in parts),
        "tolerance": KINDS[kind][2],
        "largest_errors": largest,
        "exceptions": [exception for part in parts for exception in part["exceptions"]],
    }


def summarise_live(rows, seconds):
    """The live environments' part of the result file."""
    read = [row for row in rows if row["expected"] and row["unread"] is None]
    refused = [row for row in rows if row["expected"] and row["unread"] is not None]
    unexplained = [
        {"number": row["number"]} | found for row in read for found in row["unexplained"]
    ]
    return {
        "compared": len(read),
        "simulated_seconds_each": seconds,
        "ticks": sum(row["ticks"] for row in read),
        "vehicle_ticks": sum(row["ticks"] * (row["others"] + row["controlled"]) for row in read),
        "tolerance": RUN_TOLERANCE,
        "largest_error_while_equal": max((row["largest"] for row in read), default=0.0),
        "without_any_difference": sum(row["ticks_equal"] == row["ticks"] for row in read),
        "wreck_flags": {
            "vehicle_ticks": sum(row["wreck_flags"] for row in read),
            "configurations": sum(row["wreck_flags"] > 0 for row in read),
        },
        "named": named(read),
        "refused": {row["unread"]: row["refused"] for row in refused},
        "drawn": {
            what: dict(Counter(row[what] for row in read).most_common())
            for what in ("action", "traffic", "road", "drivers")
        }
        | {"starts": dict(Counter(start for row in read for start in row["starts"]).most_common())},
        "wrongly_read_or_refused": [
            {name: row[name] for name in ("number", "unread", "refused")}
            for row in rows
            if not row["expected"]
        ],
        "differences_without_a_name": len(unexplained),
        "exceptions": [
            found | {"state": state}
            for row in read
            for found, state in zip(row["unexplained"], row["states"], strict=False)
        ][:STORED_EXCEPTIONS],
        "columns": [*COLUMNS, "names"],
        "configurations": [
            " ".join([*(f"{row[name]:.4g}" for name in COLUMNS), *row["names"]]) for row in read
        ],
    }


def named(rows):
    """How often each name was given, where it came first, and an example."""
    found = {}
    for row in rows:
        for name, count in row["names"].items():
            entry = found.setdefault(
                name,
                {
                    "differences": 0,
                    "configurations": 0,
                    "example": {"number": row["number"]} | row["examples"][name],
                },
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
            for line in lines[1:]:
                task, part = json.loads(line)
                self.parts[tuple(task)] = part
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


def perform(tasks, done, processes, seconds):
    """Do the tasks that are not done yet."""
    cost = {task: expected_seconds(*task, seconds) for task in tasks}
    left = [task for task in tasks if task not in done.parts]
    minutes = sum(cost[task] for task in left) / processes / 60
    print(f"{len(left)} of {len(tasks)} tasks, about {minutes:.0f} min", flush=True)
    finished = sum(cost[task] for task in tasks if task in done.parts)
    spawn = get_context("spawn")
    with ProcessPoolExecutor(processes, mp_context=spawn) as pool, Progress() as progress:
        progress.stage("parity with highway-env", sum(cost.values()), finished)
        futures = {pool.submit(work, *task, seconds): task for task in left}
        for future in as_completed(futures):
            task = futures[future]
            done.add(task, future.result())
            finished += cost[task]
            progress.update(finished, tasks=len(done.parts), faults=faults(done.parts))


def faults(parts):
    """How many parts would fail the campaign."""
    return sum(
        bool(part.get("exceptions") or part.get("unexplained")) or not part.get("expected", True)
        for part in parts.values()
    )


def main():
    """Run the campaign and store its result."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    count = partial(parser.add_argument, type=int)
    count("--states", default=10_000)
    count("--runs", default=1_000)
    count("--default-runs", default=200)
    count("--configurations", default=340, help="of live environments, one in 12 unrepresented")
    count("--seed", default=0)
    count("--processes", default=1)
    parser.add_argument("--seconds", type=float, default=40.0, help="of each live environment")
    parser.add_argument("--out", type=Path, default=Path("results/parity/highway-env-1.12.1.json"))
    arguments = parser.parse_args()
    seed, seconds, path = arguments.seed, arguments.seconds, arguments.out
    wanted = (arguments.states, arguments.runs, arguments.default_runs)
    numbers = {
        kind: -(-count // size)
        for (kind, (_, size, *_)), count in zip(KINDS.items(), wanted, strict=True)
    } | {LIVE: arguments.configurations}
    tasks = [(kind, seed, task) for kind, number in numbers.items() for task in range(number)]
    state = record.state(seed, seconds, within=DEPENDS_ON, packages=("highway-env",))
    done = Done(path.with_suffix(".partial"), {"state": state})
    begin = time.monotonic()
    perform(tasks, done, arguments.processes, seconds)
    parts = {task: done.parts[task] for task in tasks}
    by_kind = {kind: [part for task, part in parts.items() if task[0] == kind] for kind in numbers}
    figures = {kind: summarise(kind, by_kind[kind]) for kind in KINDS if by_kind[kind]}
    if by_kind[LIVE]:
        figures[LIVE] = summarise_live(by_kind[LIVE], seconds)
    figures["seconds"] = round(time.monotonic() - begin)
    record.store(path, figures, seed, ("highway-env",))
    done.path.unlink()
    for kind, part in figures.items():
        print(kind, part if kind == "seconds" else {n: part[n] for n in SHOWN if n in part})
    return 1 if faults(parts) else 0


if __name__ == "__main__":
    sys.exit(main())
