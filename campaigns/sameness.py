"""The same command gives the same bytes, whatever surrounds it; another seed gives others.

python campaigns/sameness.py --out results/trust/sameness.json

Every controller is trained for a few chunks, with networks and batches of full size, in processes
that differ in hash seed, number of threads, cores, folder, time zone, language, kept programs and
JAX's own switches.
Tests are driven with few and many episodes. Then a second seed, which must differ in everything.
"""

import argparse
import csv
import hashlib
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import record
from small_runs import STAGES_OF

from lanewise.runs import trained
from lanewise.system.progress import Progress

FILES = ("controller.safetensors", "metrics.jsonl", "episodes.csv", "chunks.csv")
CHUNKS, WORLDS = 3, 32
SURROUNDINGS = {
    "again": {},
    "hash seed 1, another zone and language": {
        "PYTHONHASHSEED": "1",
        "TZ": "Pacific/Kiritimati",
        "LC_ALL": "C",
    },
    "hash seed 12345": {"PYTHONHASHSEED": "12345"},
    "1 thread": {"NPROC": "1"},
    "3 threads": {"NPROC": "3"},
    "16 threads": {"NPROC": "16"},
    "one core": {"core": "one"},
    "XLA's own switch for one thread": {"XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false"},
    "programs kept": {"JAX_COMPILATION_CACHE_DIR": "kept"},
    "kept programs used": {"JAX_COMPILATION_CACHE_DIR": "kept"},
    **{
        f"{name}={value}": {name: value}
        for name, value in (
            ("JAX_ENABLE_X64", "1"),
            ("JAX_THREEFRY_PARTITIONABLE", "0"),
            ("JAX_DEFAULT_PRNG_IMPL", "rbg"),
            ("JAX_RANDOM_SEED_OFFSET", "7"),
            ("JAX_DEFAULT_MATMUL_PRECISION", "bfloat16"),
            ("JAX_NUMPY_DTYPE_PROMOTION", "strict"),
            ("JAX_NUMPY_RANK_PROMOTION", "raise"),
            ("JAX_DEBUG_KEY_REUSE", "1"),
            ("JAX_DISABLE_JIT", "1"),
        )
    },
}
"""Changes to the environment of a process, by what they are called."""
COUNTS = (1, 7, 100, 101, 230)
"""Test episodes; a compiled block has 100."""


CHANCE = 1e-4
"""Share of a layer's numbers that two seeds may have in common: of float32 draws from 2^23 values
some meet in a layer of 512 by 512."""


def arguments_of(controller):
    """Of a training of a few chunks at full size."""
    words = ["--evaluation.validation-episodes", "20", "--evaluation.duration", "10"]
    for stage in ("single-level", "high-level", "low-level", "h-dqn"):
        words += [f"--{stage}.decisions", str(CHUNKS * 50 * WORLDS)]
    return ["train", controller, *words]


def lanewise(words, place, changes):
    """Run the command line in a folder of its own; its standard output."""
    place.mkdir(parents=True, exist_ok=True)
    environment = {k: v for k, v in os.environ.items() if k != "JAX_COMPILATION_CACHE_DIR"}
    environment |= {name: value for name, value in changes.items() if name != "core"}
    if "JAX_COMPILATION_CACHE_DIR" in changes:
        environment["JAX_COMPILATION_CACHE_DIR"] = str(place.parent / "kept-programs")
        environment["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0"

    def on_one_core():
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})

    done = subprocess.run(
        [sys.executable, "-m", "lanewise", *words],
        cwd=place,
        env=environment,
        preexec_fn=on_one_core if "core" in changes else None,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise SystemExit(f"lanewise {' '.join(words)} failed:\n{done.stderr}")
    return done.stdout


def digests(path):
    """Of every file of a run that must never differ."""
    return {name: hashlib.sha256((path / name).read_bytes()).hexdigest() for name in FILES}


def training(controller, place, changes, seed=0):
    """The run folder of a training."""
    lanewise([*arguments_of(controller), "--seed", str(seed), "--out", "run"], place, changes)
    return place / "run"


def rows(run, count, place, world="lanewise", changes=None):
    """The test episodes of a run, one line each."""
    words = ["evaluate", str(run), "--episodes", str(count), "--world", world]
    lanewise([*words, "--json", "--episodes-out", "episodes.csv"], place, changes or {})
    with (place / "episodes.csv").open(newline="") as file:
        return list(csv.reader(file))[1:]


def same_training(controller, place, surroundings, step):
    """Surroundings in which some file differed, with the names of the files."""
    expected = digests(training(controller, place / "expected", {}))
    step()
    differences = {}
    for number, name in enumerate(surroundings):
        changes = SURROUNDINGS[name]
        found = digests(training(controller, place / str(number), changes))
        step()
        if found != expected:
            differences[name] = [file for file in FILES if found[file] != expected[file]]
    return differences


def same_tests(run, place, step):
    """Numbers of episodes, threads and worlds with which some episode differed."""
    most = rows(run, max(COUNTS), place / "most")
    differences = []
    for count in COUNTS:
        for threads in ("1", "2", "16"):
            found = rows(run, count, place / f"{count}-{threads}", changes={"NPROC": threads})
            step()
            if found != most[:count]:
                differences.append(f"{count} episodes, {threads} threads")
    few, more = (
        rows(run, count, place / f"highway-{count}", world="highway-env") for count in (2, 5)
    )
    if few != more[:2]:
        differences.append("2 and 5 episodes in highway-env")
    step()
    return differences


def alike(one, other):
    """What two runs of different seeds have in common and should not."""
    found = []
    for line, (a, b) in enumerate(zip(*(_figures(path) for path in (one, other)), strict=False)):
        if a == b:
            found.append(f"line {line} of chunks.csv")
    first, second = (trained.load(path).parameters for path in (one, other))
    for level in first:
        for layer, (a, b) in enumerate(zip(first[level], second[level], strict=True)):
            for name, x, y in zip(("weights", "biases"), a, b, strict=True):
                if (x == y).mean() > CHANCE:
                    found.append(f"{level}, layer {layer}, {name}")
    return found


def _figures(path):
    """What the chunks of a run say of its learning."""
    with (path / "chunks.csv").open(newline="") as file:
        for row in csv.DictReader(file):
            yield tuple(row[name] for name in ("loss", "mean_q", "reward", "speed"))


def main():
    """Run the campaign, store what it found, and tell by the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--controllers", nargs="+", default=list(STAGES_OF), choices=STAGES_OF)
    parser.add_argument(
        "--surroundings", nargs="+", default=list(SURROUNDINGS), choices=SURROUNDINGS
    )
    parser.add_argument("--no-tests", action="store_true", help="trainings alone")
    parser.add_argument("--out", type=Path, default=Path("results/trust/sameness.json"))
    arguments = parser.parse_args()
    chosen = {name: SURROUNDINGS[name] for name in arguments.surroundings}
    counts = () if arguments.no_tests else COUNTS
    figures = {"surroundings": chosen, "files": FILES, "counts": counts, "controllers": {}}
    done = 0

    def step():
        nonlocal done
        done += 1
        reporter.update(done, differences=wrong())

    def wrong():
        return sum(
            len(part) for found in figures["controllers"].values() for part in found.values()
        )

    with tempfile.TemporaryDirectory() as folder, Progress() as reporter:
        each = len(chosen) + 2 + (3 * len(counts) + 1 if counts else 0)
        reporter.stage("processes", each * len(arguments.controllers))
        for controller in arguments.controllers:
            place = Path(folder) / controller
            found = figures["controllers"][controller] = {}
            found["trainings_that_differ"] = same_training(controller, place, chosen, step)
            run = place / "expected" / "run"
            if counts:
                found["tests_that_differ"] = same_tests(run, place / "tests", step)
            other = training(controller, place / "other", {}, seed=1)
            found["alike_in_another_seed"] = alike(run, other)
            step()
    record.store(arguments.out, figures)
    print(f"{done} processes or pairs of them, {wrong()} differences")
    return 1 if wrong() else 0


if __name__ == "__main__":
    sys.exit(main())
