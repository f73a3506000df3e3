"""What promises of docs/trust.md cost: an update and a chunk, with and without what they need.

python campaigns/costs.py

Both ways are compiled, then take turns in one process, so that whatever else the machine does falls
on both; each turn gives a ratio of their rates. Let the machine do nothing else meanwhile.
"""

import argparse
import sys
import time
from pathlib import Path
from statistics import median
from unittest.mock import patch

import jax
import record

from lanewise.bench import workloads
from lanewise.learning import network
from lanewise.system.progress import Progress
from lanewise.training import finite, stage

SAME_GRADIENT = "update, batch 64: a gradient that is the same on any number of cores"
LOOK = "chunk, {} worlds, an update a step: the look at its numbers"
WORLDS = (1, 32)


def plain_layer(features, weights, biases):
    """A layer whose gradient is XLA's own."""
    return features @ weights + biases


def updates(seconds):
    """Two measurements of updates a second: as they are, and with XLA's own gradient."""
    ours = workloads.update(seconds)
    with patch.object(network, "_layer", plain_layer):
        plain = workloads.update(seconds)
    return lambda: ours()["value"], lambda: plain()["value"]


def chunks(worlds, seconds):
    """Two measurements of steps a second: as they are, and without the look."""
    plan = workloads.training_plan(worlds, workloads.WARM_UP)
    states = [workloads.past_warm_up(plan, seed=0).state for _ in range(2)]
    ours = Chunks(plan.course, states[0], seconds)
    with (
        patch.object(finite, "between", lambda *_: None),
        patch.object(finite, "of_chunk", lambda *_: None),
    ):
        bare = Chunks(plan.course, states[1], seconds)
    return ours, bare


class Chunks:
    """Training that goes on from call to call; a call tells how many steps a second it made."""

    def __init__(self, course, state, seconds):
        self.course, self.state, self.seconds = course, state, seconds
        # A function of its own, as JAX finds compiled ones again by their identity.
        self.advance = jax.jit(
            lambda state: stage.iterate(course, {}, state, stage.CHUNK), donate_argnums=0
        )
        self._chunk()

    def _chunk(self):
        self.state, _ = jax.block_until_ready(self.advance(self.state))

    def __call__(self):
        chunks, began = 0, time.perf_counter()
        while time.perf_counter() - began < self.seconds:
            self._chunk()
            chunks += 1
        steps = chunks * stage.CHUNK * self.course.budget.worlds
        return steps / (time.perf_counter() - began)


def compared(ours, without, turns, tell):
    """Rates of both by turn, who goes first changing, and what the ratios say."""
    rates = {"ours": [], "without": []}
    for turn in range(turns):
        both = [("ours", ours), ("without", without)]
        for name, measure in both if turn % 2 else reversed(both):
            rates[name].append(measure())
        tell(turn + 1)
    ratios = [a / b for a, b in zip(rates["ours"], rates["without"], strict=True)]
    return {
        "ratio": round(median(ratios), 4),
        "least": round(min(ratios), 4),
        "most": round(max(ratios), 4),
        "ours": round(median(rates["ours"]), 1),
        "without": round(median(rates["without"]), 1),
        "turns": turns,
    }


def main():
    """Measure, and store what came of it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=3.0, help="of each measurement")
    parser.add_argument("--turns", type=int, default=11)
    parser.add_argument("--out", type=Path, default=Path("results/trust/costs.json"))
    arguments = parser.parse_args()
    cases = {SAME_GRADIENT: updates}
    cases |= {LOOK.format(n): lambda seconds, n=n: chunks(n, seconds) for n in WORLDS}
    found = {}
    with Progress() as reporter:
        for name, prepare in cases.items():
            reporter.stage(name, arguments.turns)
            pair = prepare(arguments.seconds)
            found[name] = compared(*pair, arguments.turns, reporter.update)
            reporter.note(f"{name}: {found[name]}")
    record.store(arguments.out, {"seconds": arguments.seconds, "costs": found}, seed=0)


if __name__ == "__main__":
    sys.exit(main())
