"""Stop trainings at random points, continue them, and compare every byte with one never stopped.

    python campaigns/resumes.py --trials 160 --out results/trust/resumes.json

Each training is stopped one to three times, in any stage: by Ctrl-C, which saves, or by a kill. A
kill loses what came after the newest checkpoint, perhaps the newest checkpoint itself, and may cut
the last line of the metrics. The checkpoint that a training continues from says where it stopped.
"""

import os
import signal
import sys
import tempfile
from contextlib import suppress
from functools import partial
from pathlib import Path

import numpy as np
import record
import small_runs
from small_runs import STAGES_OF, Quiet

from lanewise.runs import checkpoint, training_loop
from lanewise.runs.run_folder import RunFolder
from lanewise.system.progress import Progress

CHUNKS, EPSILON_CHUNKS, SEED = 12, 8, 7
"""Chunks of every stage, and the chunks over which epsilon falls."""
WAYS = ("interrupt", "kill", "kill, newest checkpoint lost")
FLAGS = small_runs.flags(CHUNKS, EPSILON_CHUNKS)


class KilledError(BaseException):
    """Stands for a kill: nothing may catch it."""


def kill():
    """Stop the training without a chance to save."""
    raise KilledError


def press_ctrl_c():
    """Stop the training as a user does."""
    os.kill(os.getpid(), signal.SIGINT)


def trial(path, controller, rng):
    """Train with up to three random stops; returns a description of each."""
    stops, wanted = [], int(rng.integers(1, 4))
    while True:
        begin = partial(small_runs.create, path, FLAGS, controller, SEED)
        opened = RunFolder.resume(path) if stops else begin()
        at = (str(rng.choice(STAGES_OF[controller])), int(rng.integers(CHUNKS)))
        way = str(rng.choice(WAYS))
        stop = Quiet(at, press_ctrl_c if way == "interrupt" else kill)
        with opened as folder, suppress(KeyboardInterrupt, KilledError):
            small_runs.train(folder, Quiet() if len(stops) == wanted else stop)
            return stops
        if way != "interrupt":
            lose(path, way, rng)
        described = {"controller": controller, "stage": at[0], "chunks": at[1], "way": way}
        stops.append(described | where(path / "checkpoints"))


def lose(path, way, rng):
    """Remove what a kill loses: the end of the metrics, perhaps the newest checkpoint."""
    names = checkpoint.names(path / "checkpoints")
    if way != "kill" and names:
        (path / "checkpoints" / f"{names.pop()}.json").unlink()
    saved = [(path / "checkpoints", name) for name in names[-1:]]
    saved += [(path / "stages", file.stem) for file in (path / "stages").glob("*.json")]
    safe = max((checkpoint.load(*each).meta["metrics_bytes"] for each in saved), default=0)
    metrics = path / "metrics.jsonl"
    os.truncate(metrics, rng.integers(safe, metrics.stat().st_size + 1))


def where(folder):
    """Where in the training its newest checkpoint lies."""
    names = checkpoint.names(folder)
    if not names:
        return {"continues_from": None}
    found = checkpoint.load(folder, names[-1])
    memory = "state/rollouts/memory/"
    ages = [found.tree.get(memory + name, np.zeros(1)) for name in ("goal/age", "age")]
    return {
        "continues_from": found.name,
        "inside_an_episode": bool((found.tree["state/rollouts/episode/stats/decisions"] > 0).any()),
        "inside_a_goal": any(bool((age > 0).any()) for age in ages),
        "epsilon_is_falling": found.meta["counters"]["chunks"] < EPSILON_CHUNKS,
    }


def main():
    """Run the campaign, store what it found, and exit with 1 if a file differs."""
    arguments = record.parse(__doc__, "resumes", trials=160)
    training_loop.INTERVAL = 0.0  # A checkpoint after every chunk.
    rng, expected, stops, differences = np.random.default_rng(arguments.seed), {}, [], []
    with tempfile.TemporaryDirectory() as temporary, Progress() as progress:
        progress.stage("trainings", arguments.trials)
        for number in range(arguments.trials):
            controller = list(STAGES_OF)[number % len(STAGES_OF)]
            whole, path = Path(temporary, controller), Path(temporary, str(number))
            if controller not in expected:
                with small_runs.create(whole, FLAGS, controller, SEED) as folder:
                    small_runs.train(folder)
                expected[controller] = small_runs.results(whole)
            fell = trial(path, controller, rng)
            for name, content in small_runs.results(path).items():
                if content != expected[controller][name]:
                    differences.append({"trial": number, "file": name, "stops": fell})
            stops += fell
            progress.update(number + 1, stops=len(stops), differences=len(differences))
    flags = ("inside_an_episode", "inside_a_goal", "epsilon_is_falling")
    counts = {flag: sum(stop.get(flag, False) for stop in stops) for flag in flags}
    found = {"trials": arguments.trials, "stops": len(stops), **counts, "differences": differences}
    record.store(arguments.out, found | {"every_stop": stops}, arguments.seed)
    print(f"{len(stops)} stops, {len(differences)} files that differ")
    return 1 if differences else 0


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)
    sys.exit(main())
