"""Measure other libraries and Lanewise beside each other, and print and store the ratios.

python benchmarks/peers.py world latency --out peers.json
python benchmarks/peers.py --python peers/envpool/bin/python peers/sb3/bin/python --out bench.json

benchmarks/README.md says how to install the peers. Those that no interpreter has are left out.
"""

import argparse
import json
import subprocess
import sys
from dataclasses import asdict
from functools import partial
from pathlib import Path

import ratios
from ratios import LEVEL, LEVEL_CACHED, SB3_TRAINING

from lanewise.bench import session, suite
from lanewise.bench.suite import LANES, Benchmark, plural, training_case, update_case
from lanewise.bench.workloads import update_flops
from lanewise.driving import actions, observation
from lanewise.errors import LanewiseError, shell_line
from lanewise.learning.settings import LearnerSettings
from lanewise.system import process

HERE = Path(__file__).parent
PARTS = (*suite.PARTS, "level")
NEEDS = {
    "highway-env": ("highway-env", "lanewise"),
    "EnvPool": ("envpool",),
    "PyTorch": ("torch",),
    "Stable-Baselines3": ("stable_baselines3", "torch"),
    "Stable-Baselines3 on highway-env": ("stable_baselines3", "highway-env", "lanewise"),
}
"""Distributions that must be installed beside one another to measure a peer."""
ASK = """
import json, sys
from importlib.metadata import PackageNotFoundError, version
found = {}
for name in sys.argv[1:]:
    try:
        found[name] = version(name)
    except PackageNotFoundError:
        pass
print(json.dumps(found))
"""
SAME = 200
"""Starts whose endings are compared with highway-env's, to know that the work is the same."""
ENVS = (64, 512)
"""In EnvPool's pool: neither is always the faster, and the better counts."""


def installed(python):
    """Versions of the peers' distributions for an interpreter."""
    names = sorted({name for names in NEEDS.values() for name in names})
    try:
        asked = subprocess.run(
            [python, "-c", ASK, *names], capture_output=True, text=True, check=True
        )
        return json.loads(asked.stdout)
    except (OSError, subprocess.SubprocessError, ValueError) as error:
        raise LanewiseError(
            f"--python: {python} is no Python interpreter; give one such as peers/bin/python"
        ) from error


def beside(seconds, seeds, count, python):
    """The benchmarks that are measured beside those of `lanewise bench`.

    ``python`` holds, by name of `NEEDS`, an interpreter that has it, if there is one.
    """
    learner = LearnerSettings()
    inner, columns = learner.hidden
    product = {"rows": learner.batch_size, "inner": inner, "columns": columns, "seconds": seconds}
    networks = {
        "hidden": learner.hidden,
        "batch": learner.batch_size,
        "capacity": learner.replay_capacity,
        "learning_rate": learner.learning_rate,
        "discount": learner.discount,
    }
    shape = {"inputs": observation.SIZE, "outputs": actions.COUNT, "seconds": seconds}
    work = update_flops(observation.SIZE, learner.hidden, actions.COUNT, learner.batch_size)
    torch_update = networks | shape | {"target_rate": learner.target_rate, "flops": work}
    found = []

    def add(peer, file, part, case, subject, function, arguments, cores=count, apart=False):
        if peer is None or peer in python:
            found.append(
                Benchmark(
                    part=part, case=case, subject=subject, function=function, arguments=arguments,
                    cores=cores, apart=apart, file=HERE / file,
                    python=python.get(peer, Path(sys.executable)),
                )
            )  # fmt: skip

    envpool = partial(add, "EnvPool", "peer_envpool.py", "world")
    highway_env = partial(add, "highway-env", "peer_highway_env.py")
    for used in sorted({1, count}):
        for vehicles, lanes in LANES.items():
            size = {"vehicles": vehicles, "lanes": lanes, "seconds": seconds}
            case = f"{vehicles} vehicles, {plural(used, 'core')}"
            highway_env("world", case, "highway-env", "world", size, used, apart=True)
            settings = {
                "vehicles_count": vehicles - 1, "lanes_count": lanes, "simulation_frequency": 10,
                "policy_frequency": 2, "duration": 25, "max_episode_steps": 50,
            }  # fmt: skip
            pool = {"threads": used, "seconds": seconds}
            for envs in ENVS:
                given = pool | {"task": "highway-v0", "envs": envs, "settings": settings}
                envpool(case, f"EnvPool, {envs} environments", "world", given, used)
        case = f"EnvPool as it comes, {plural(used, 'core')}"
        for task in ("highway-v0", "highway-fast-v0"):
            for envs in ENVS:
                given = pool | {"task": task, "envs": envs, "settings": {}}
                envpool(case, f"EnvPool {task}, {envs} environments", "world", given, used)
        case = update_case(used)
        own = partial(add, None, "own_workloads.py", "update", case)
        own("matrix product, XLA", "matrix_product", product, used)
        torch = partial(add, "PyTorch", "peer_torch.py", "update", case, cores=used)
        torch("matrix product, PyTorch", "matrix_product", product)
        torch("PyTorch, double DQN", "update", torch_update)
        compiled = torch_update | {"compiled": True}
        torch("PyTorch, double DQN, torch.compile", "update", compiled)
        sb3 = partial(add, "Stable-Baselines3", "peer_sb3.py", "update", case)
        sb3("Stable-Baselines3, DQN", "update", networks | shape, used)
    same = {"vehicles": 12, "lanes": LANES[12], "count": SAME}
    highway_env("world", f"{SAME} starts with 12 vehicles", "lanewise", "same_endings", same, 1)
    for vehicles, lanes in LANES.items():
        size = {"vehicles": vehicles, "lanes": lanes, "seconds": seconds, "latency": True}
        highway_env("latency", f"{vehicles} vehicles, 1 core", "highway-env", "world", size, 1)
    size = networks | {"vehicles": 12, "lanes": LANES[12], "seconds": seconds}
    trained = partial(add, "Stable-Baselines3 on highway-env", "peer_sb3.py", "training")
    for apart in (False, True) if count > 1 else (False,):
        trained(training_case(apart, count), SB3_TRAINING, "training", size, apart=apart)
    for case, number in ((LEVEL, seeds), (LEVEL_CACHED, 1)):
        for seed in range(number):
            given = {"training_seed": seed, "cached": case == LEVEL_CACHED}
            subject = f"lanewise, seed {seed}"
            add(None, "own_workloads.py", "level", case, subject, "level", given)
    return found


def ordered(benchmarks):
    """By part, then by case as they first came, so that what is compared is measured together."""
    cases = list(dict.fromkeys((each.part, each.case) for each in benchmarks))
    return sorted(
        benchmarks, key=lambda each: (PARTS.index(each.part), cases.index((each.part, each.case)))
    )


def main(words=None):
    """Measure, print and store; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"any of {', '.join(PARTS)}")
    parser.add_argument("--seconds", type=float, default=5.0, help="of each measurement")
    parser.add_argument("--seeds", type=int, default=5, help="trainings of the part level")
    parser.add_argument("--python", type=Path, nargs="+", default=[], help="others' interpreters")
    parser.add_argument("--out", type=Path, help="new file for the result, JSON")
    options = parser.parse_args(words)
    if unknown := set(options.parts) - set(PARTS):
        parser.error(f"unknown part {sorted(unknown)[0]}; use {', '.join(PARTS)}")
    session.check_out(options.out)
    versions = {path: installed(path) for path in (Path(sys.executable), *options.python)}
    python = {}
    for peer, needs in NEEDS.items():
        having = [path for path, there in versions.items() if set(needs) <= set(there)]
        python |= {peer: having[0]} if having else {}
    chosen, count = options.parts or PARTS, len(process.usable_cores())
    ours = suite.benchmarks(options.seconds, count, "gpu" in chosen and suite.has_gpu())
    theirs = beside(options.seconds, options.seeds, count, python)

    def compare(figures):
        found = ratios.of(figures, count)
        return {"ratios": [asdict(ratio) for ratio in found]}, ratios.table(found)

    return session.run(
        [each for each in ordered([*ours, *theirs]) if each.part in chosen],
        {"command": shell_line("python", *sys.argv), "seconds": options.seconds},
        options.out,
        notes=[f"not installed, left out: {peer}" for peer in NEEDS if peer not in python],
        # Of each peer where it is measured first.
        versions={name: v for there in reversed(versions.values()) for name, v in there.items()},
        compare=compare,
    )


if __name__ == "__main__":
    try:
        sys.exit(main())
    except LanewiseError as error:
        print(f"peers.py: error: {error}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        # What was measured is printed and stored.
        sys.exit(130)
