"""Measure how well our world equals highway-env, over random states and free runs.

python benchmarks/parity.py --states 10000 --runs 1000 --default-runs 200 --processes 2 \
    --out results/parity/highway-env-1.12.1.json
"""

import argparse
import json
import os
import platform
import shlex
import sys
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from datetime import UTC, datetime
from importlib.metadata import version
from multiprocessing import get_context
from pathlib import Path

os.environ["JAX_ENABLE_X64"] = "1"
os.environ.setdefault("JAX_PLATFORMS", "cpu")

import numpy as np
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
from parity_states import SIZES, paper_traffic, random_state

from lanewise.interop.highway_env import build_env, read_world

STATES_A_TASK, RUNS_A_TASK, DEFAULT_RUNS_A_TASK = 240, 20, 4
BATCH = 40
"""One batch shape per size, so that each process compiles two ticks and two runs."""


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
    return done, largest, exceptions


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
    return len(envs), largest, exceptions


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
    "random_states": (random_states, STATES_A_TASK, STATE_TOLERANCE),
    "paper_runs": (paper_runs, RUNS_A_TASK, RUN_TOLERANCE),
    "default_runs": (default_runs, DEFAULT_RUNS_A_TASK, RUN_TOLERANCE),
}


def work(kind, seed, task):
    """One task, for a worker process."""
    function, count, _ = KINDS[kind]
    return kind, function(seed, task, count)


def processor():
    """The processor's name."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor()


def provenance(arguments):
    """What made the result."""
    packages = ("lanewise", "highway-env", "jax", "jaxlib", "numpy", "gymnasium")
    return {
        "command": shlex.join(["python", "benchmarks/parity.py", *sys.argv[1:]]),
        "seed": arguments.seed,
        "versions": {"python": platform.python_version()} | {p: version(p) for p in packages},
        "machine": {"platform": platform.platform(), "cpu": processor(), "cores": os.cpu_count()},
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def summarise(kind, results):
    """One kind's part of the result file."""
    parts = [result for name, result in results if name == kind]
    largest = {name: max((part[1][name] for part in parts), default=0.0) for name in CONTINUOUS}
    return {
        "compared": sum(part[0] for part in parts),
        "tolerance": KINDS[kind][2],
        "largest_errors": largest,
        "exceptions": [exception for part in parts for exception in part[2]],
    }


def main():
    """Run the campaign and store its result."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--states", type=int, default=10_000)
    parser.add_argument("--runs", type=int, default=1_000)
    parser.add_argument("--default-runs", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("results/parity/highway-env-1.12.1.json"))
    arguments = parser.parse_args()
    wanted = (arguments.states, arguments.runs, arguments.default_runs)
    tasks = [
        (kind, arguments.seed, task)
        for (kind, (_, size, _)), count in zip(KINDS.items(), wanted, strict=True)
        for task in range(-(-count // size))
    ]
    begin, results = time.monotonic(), []
    with ProcessPoolExecutor(arguments.processes, mp_context=get_context("spawn")) as pool:
        futures = [pool.submit(work, *task) for task in tasks]
        for number, future in enumerate(as_completed(futures), 1):
            kind, part = future.result()
            results.append((kind, part))
            found = sum(len(result[2]) for _, result in results)
            spent = time.monotonic() - begin
            print(f"{number}/{len(tasks)} {kind}: {found} exceptions, {spent:.0f} s", flush=True)
    document = provenance(arguments) | {kind: summarise(kind, results) for kind in KINDS}
    document["seconds"] = round(time.monotonic() - begin)
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    arguments.out.write_text(json.dumps(document, indent=1) + "\n")
    for kind in KINDS:
        part = document[kind]
        print(kind, part["compared"], "compared,", len(part["exceptions"]), "exceptions,")
        print("  largest errors", part["largest_errors"])


if __name__ == "__main__":
    main()
