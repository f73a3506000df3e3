"""Stop trainings at random points, continue them, and compare every byte with one never stopped.

python campaigns/resumes.py --trials 160 --out results/trust/resumes.json

A training is stopped one to three times, in any stage, by Ctrl-C (which saves) or by a kill: what
came after the newest checkpoint is gone, perhaps with the newest checkpoint itself, and the last
line of the metrics may be cut short. Where each stop fell, inside episodes, goals and the fall of
epsilon, is read from the checkpoint that the training continued from.
"""

import argparse
import os
import shutil
import signal
import sys
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np
import record
import small_runs
from small_runs import STAGES_OF, Quiet

from lanewise.runs import checkpoint, training_loop
from lanewise.runs.run_folder import RunFolder
from lanewise.system.progress import Progress

CHUNKS, EPSILON_CHUNKS = 12, 8
"""Of every stage, and over which of them epsilon falls: stops fall before and after its end."""
SEED = 7
WAYS = ("interrupt", "kill", "kill, newest checkpoint lost")
FLAGS = small_runs.flags(CHUNKS, EPSILON_CHUNKS)


class KilledError(BaseException):
    """Stands for a kill: nothing may catch it."""


def whole(path, controller):
    """A run that was never stopped."""
    with small_runs.create(path, FLAGS, controller, SEED) as folder:
        small_runs.train(folder)


def trial(path, controller, rng):
    """Train with random stops.

    Returns:
        A description of each stop.
    """
    training_loop.INTERVAL = 0.0
    stops = []
    wanted = int(rng.integers(1, 4))
    opened = small_runs.create(path, FLAGS, controller, SEED)
    while True:
        with opened as folder:
            if len(stops) == wanted:
                small_runs.train(folder)
                return stops
            stop = {
                "controller": controller,
                "stage": str(rng.choice(STAGES_OF[controller])),
                "chunks": int(rng.integers(0, CHUNKS)),
                "way": str(rng.choice(WAYS)),
            }
            try:
                small_runs.train(folder, Quiet((stop["stage"], stop["chunks"]), _action(stop)))
            except (KeyboardInterrupt, KilledError):
                pass
            else:
                return stops  # It had come past that point, and ended.
            _lose(path, stop["way"], rng)
            stops.append(stop | _where(path))
        opened = RunFolder.resume(path)


def _action(stop):
    def press_ctrl_c():
        os.kill(os.getpid(), signal.SIGINT)

    def kill():
        raise KilledError

    return press_ctrl_c if stop["way"] == "interrupt" else kill


def _lose(path, way, rng):
    """What a kill takes with it: the end of the metrics, perhaps a checkpoint."""
    if way == "interrupt":
        return
    folder = path / "checkpoints"
    names = checkpoint.names(folder)
    if way != "kill" and names:
        (folder / f"{names.pop()}.json").unlink()
    metrics = path / "metrics.jsonl"
    safe = max((_meta(folder, name)["metrics_bytes"] for name in names[-1:]), default=0)
    for stage in (path / "stages").glob("*.json"):
        safe = max(safe, _meta(stage.parent, stage.stem)["metrics_bytes"])
    os.truncate(metrics, rng.integers(safe, metrics.stat().st_size + 1))


def _meta(folder, name):
    return checkpoint.read_meta(folder, name)


def _where(path):
    """Where in the training the newest checkpoint lies; an empty stop continues from nothing."""
    folder = path / "checkpoints"
    names = checkpoint.names(folder)
    if not names:
        return {"continues_from": None}
    found = checkpoint.load(folder, names[-1])
    arrays, chunk = found.tree, found.meta["ledger"]["chunks"]
    ages = arrays.get("state/rollouts/memory/goal/age", arrays.get("state/rollouts/memory/age"))
    return {
        "continues_from": found.name,
        "inside_an_episode": bool((arrays["state/rollouts/episode/decisions"] > 0).any()),
        "inside_a_goal": ages is not None and bool((ages > 0).any()),
        "epsilon_is_falling": chunk < EPSILON_CHUNKS,
        "replay_has_wrapped": any(
            int(arrays[name]) > small_runs.LEVEL["learner.replay_capacity"]
            for name in arrays
            if name.endswith("/position")
        ),
    }


def campaign(trials, seed, place, reporter):
    """So many trials over all controllers.

    Returns:
        The stops of every trial, and a line for each file that differed.
    """
    rng = np.random.default_rng(seed)
    controllers = tuple(STAGES_OF)
    expected = {}
    reporter.stage("trainings", trials)
    stops, differences = [], []
    for number in range(trials):
        controller = controllers[number % len(controllers)]
        if controller not in expected:
            whole(place / "whole" / controller, controller)
            expected[controller] = small_runs.results(place / "whole" / controller)
        path = place / f"trial-{number}"
        fell = trial(path, controller, rng)
        found = small_runs.results(path)
        differences += [
            {"trial": number, "file": name, "stops": fell}
            for name in found
            if found[name] != expected[controller][name]
        ]
        stops += fell
        shutil.rmtree(path)
        reporter.update(number + 1, stops=len(stops), differences=len(differences))
    return stops, differences


def summary(stops):
    """How many stops fell where."""
    flags = ("inside_an_episode", "inside_a_goal", "epsilon_is_falling", "replay_has_wrapped")
    return {
        "stops": len(stops),
        "different_stop_points": len({(s["controller"], s["continues_from"]) for s in stops}),
        "from_no_checkpoint": sum(stop["continues_from"] is None for stop in stops),
        **{flag: sum(bool(stop.get(flag)) for stop in stops) for flag in flags},
        "by_controller_and_stage": dict(
            sorted(Counter(f"{s['controller']}, {s['stage']}" for s in stops).items())
        ),
        "by_way": dict(sorted(Counter(stop["way"] for stop in stops).items())),
    }


def main():
    """Run the campaign, store what it found, and tell by the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=160)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("results/trust/resumes.json"))
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as place, Progress() as reporter:
        stops, differences = campaign(arguments.trials, arguments.seed, Path(place), reporter)
    figures = {"trials": arguments.trials, **summary(stops), "differences": differences}
    record.store(arguments.out, figures | {"every_stop": stops}, arguments.seed)
    print(f"{len(stops)} stops, {len(differences)} files that differ")
    return 1 if differences else 0


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)
    sys.exit(main())
