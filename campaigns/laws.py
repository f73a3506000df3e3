"""Hold the world against its laws: symmetries, invariants, limits, each with its bound.

python campaigns/laws.py --states 2048 --out results/trust/laws.json
"""

import argparse
import os
import sys
import time
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

from lanewise.progress import Progress

WORLD_LAWS = law_symmetries.LAWS + law_company.LAWS + law_motion.LAWS + law_ticks.LAWS
DRIVING_LAWS = law_driving.LAWS
LAWS = (*WORLD_LAWS, *DRIVING_LAWS, *law_episodes.LAWS)
"""All of them, by name."""
BATCH = 64
VEHICLES = (16, 32)
"""At most in a world; batches take turns."""
SHOWN = 20
"""Breaches of a law written down; all are counted."""


def hold(law, states, seed, progress=None):
    """Hold one law against random worlds until so many examples were seen.

    Batch b of seed s is the same worlds in every run, whichever laws are asked for.

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
        rng = np.random.default_rng([seed, batch])
        worlds = None
        if law not in law_episodes.LAWS:
            worlds = random_worlds(rng, BATCH, VEHICLES[batch % len(VEHICLES)])
        total.add(law.check(worlds, rng), batch)
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


def main():
    """Run the campaign and store its result."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--states", type=int, default=2048, help="examples of each law, at least")
    parser.add_argument("--laws", nargs="+", choices=[law.name for law in LAWS], metavar="LAW")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("results/trust/laws.json"))
    arguments = parser.parse_args()
    laws = [law for law in LAWS if not arguments.laws or law.name in arguments.laws]
    results = {}
    with Progress() as progress:
        for law in laws:
            progress.stage(law.name, arguments.states)
            begin = time.monotonic()
            found = hold(law, arguments.states, arguments.seed, progress)
            results[law.name] = figures(law, found, time.monotonic() - begin)
            if found.broken:
                progress.note(f"{law.name}: {len(found.broken)} exceptions, {found.broken[0]}")
    broken = sum(result["exceptions"] for result in results.values())
    record.store(arguments.out, {"exceptions": broken, "laws": results}, arguments.seed)
    print(f"{len(laws)} laws, {broken} exceptions; see {arguments.out}")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
