"""Hold the world against its laws: symmetries, invariants, limits, each with its bound.

python campaigns/laws.py --states 2048 --out results/trust/laws.json
"""

import argparse
import json
import os
import sys
import time
from functools import cache
from pathlib import Path

os.environ.setdefault("JAX_PLATFORMS", "cpu")

import law_company
import law_driving
import law_episodes
import law_motion
import law_symmetries
import law_ticks
import numpy as np
import record
from law_worlds import Found, random_worlds

from lanewise.system.progress import Progress

WORLD_LAWS = law_symmetries.LAWS + law_company.LAWS + law_motion.LAWS + law_ticks.LAWS
DRIVING_LAWS = law_driving.LAWS
LAWS = (*WORLD_LAWS, *DRIVING_LAWS, *law_episodes.LAWS)
"""All of them, by name."""
BATCH, VEHICLES = 64, 16
"""Worlds in a batch, and vehicles in a world at most."""
SHOWN = 20
"""Breaches of a law written down; all are counted."""


@cache
def batch_of(seed, batch):
    """The worlds of a batch: the same in every run, and for every law."""
    return random_worlds(np.random.default_rng([seed, 0, batch]), BATCH, VEHICLES)


def hold(law, states, seed, progress=None):
    """Hold one law against random worlds until so many examples were seen.

    Args:
        law: the law.
        states: examples wanted, at least.
        seed: of the worlds, and of what is done to them.
        progress: is told how far this is.

    Returns:
        What was found.
    """
    total, batch = Found(), 0
    while total.examples < states:
        worlds = None if law in law_episodes.LAWS else batch_of(seed, batch)
        total.add(law.check(worlds, np.random.default_rng([seed, 1, batch])), batch)
        batch += 1
        if progress is not None:
            progress.update(min(total.examples, states), broken=len(total.broken))
    return total


def figures(law, found, seconds):
    """A law's part of the result file."""
    return {
        "statement": law.statement,
        "bound": law.bound,
        "examples_from": law.source,
        "examples": found.examples,
        "largest_deviation": found.deviation,
        "met_on_the_way": dict(sorted(found.quirks.items())),
        "exceptions": len(found.broken),
        "first_exceptions": found.broken[:SHOWN],
        "seconds": round(seconds, 1),
    }


def stored(path, states, seed):
    """Results of the same campaign, as far as it came; by law."""
    document = json.loads(path.read_text()) if path.exists() else {}
    same = (document.get("states"), document.get("seed")) == (states, seed)
    return document["laws"] if same else {}


def store(path, results, states, seed):
    """Write what is known so far, in the laws' own order; returns the number of exceptions."""
    results = {law.name: results[law.name] for law in LAWS if law.name in results}
    broken = sum(result["exceptions"] for result in results.values())
    record.store(path, {"states": states, "exceptions": broken, "laws": results}, seed)
    return broken


def main():
    """Run the campaign and store its result, law by law; what is stored is not done again."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--states", type=int, default=2048, help="examples of each law, at least")
    parser.add_argument("--laws", nargs="+", choices=[law.name for law in LAWS], metavar="LAW")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("results/trust/laws.json"))
    arguments = parser.parse_args()
    states, seed, path = arguments.states, arguments.seed, arguments.out
    laws = [law for law in LAWS if not arguments.laws or law.name in arguments.laws]
    with Progress() as progress:
        for law in laws:
            if law.name in stored(path, states, seed):
                continue
            progress.stage(law.name, states)
            begin = time.monotonic()
            found = hold(law, states, seed, progress)
            seconds = time.monotonic() - begin
            results = stored(path, states, seed) | {law.name: figures(law, found, seconds)}
            store(path, results, states, seed)
            if found.broken:
                progress.note(f"{law.name}: {len(found.broken)} exceptions, {found.broken[0]}")
    results = stored(path, states, seed)
    broken = store(path, results, states, seed)
    print(f"{len(results)} laws, {broken} exceptions; see {path}")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
