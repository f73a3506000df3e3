"""Try settings on validation starts: the search behind the ``quick`` preset.

    python benchmarks/search.py step-1 --seed 0 --keep runs/search/a --set goals.time_limit=2
    python benchmarks/search.py step-2 --seed 0 --high-level runs/search/a \\
        --set low_level.tracking_weight=1

Trains one stage and tests its weights on 1,000 validation starts of another seed than the one
that chose them; never on the test start. One line of JSON a call goes to ``--out``.
"""

import argparse
import json
import time
from pathlib import Path

import jax
import numpy as np

from lanewise import config
from lanewise.evaluation import evaluator, metrics
from lanewise.report.provenance import machine, source, versions
from lanewise.runs import checkpoint, tree
from lanewise.runs.folder import RunFolder
from lanewise.runs.train import plan_of
from lanewise.training import host, recipe

STAGES = {stage.name: (i, stage) for r in recipe.RECIPES.values() for i, stage in enumerate(r)}
UNSEEN_SEED = 1
"""Of the validation starts that judge; the training's own choose by `VALIDATION_SEED`."""
EPISODES = 1000


def main() -> None:
    """Train and judge one stage."""
    options = _options()
    changes = dict(change.split("=", 1) for change in options.set)
    kinds = config.kinds()
    flags = {name: kinds[name].parse(name, value.split(",")) for name, value in changes.items()}
    settings = config.compose(flags=flags)
    index, stage = STAGES[options.stage]
    plan = plan_of(RunFolder(Path(), settings, "search", options.seed, ""), stage)
    frozen = {}
    began = time.monotonic()
    if options.high_level:
        stored = checkpoint.load(options.high_level, "step-1").arrays
        first = plan_of(RunFolder(Path(), settings, "search", 0, ""), STAGES["step-1"][1])
        blank = jax.eval_shape(lambda: host.stage.begin(first.course, {}, jax.random.key(0)))
        frozen = tree.unflatten(host.stage.online(blank.learners), stored)
    now = host.begin(plan, frozen, jax.random.fold_in(jax.random.key(options.seed), index))
    while not plan.finished(now.ledger):
        now, report = host.advance(plan, frozen, now)
        if "validation_success_rate" in report.chunk:
            names = (
                "decisions",
                "validation_success_rate",
                "validation_accident_rate",
                "validation_reward",
                "loss",
            )
            print({name: report.chunk[name] for name in names}, flush=True)
    parameters = host.result(plan, now)
    if options.keep:
        checkpoint.save(options.keep, stage.name, tree.flatten(parameters), {}, "search")
    episodes = evaluator.evaluate(plan.validation, frozen | parameters, UNSEEN_SEED, EPISODES)
    row = {
        "stage": stage.name,
        "seed": options.seed,
        "changes": changes,
        **source(),
        "versions": versions(),
        "machine": machine(),
        "seconds": round(time.monotonic() - began, 1),
        "best_chunk": now.ledger.best_chunk,
        "escape_time": float(np.nanmean(episodes.escape_time)),
        "validation": metrics.summarise(
            episodes, controller=stage.name, world="lanewise"
        ).to_json(),
    }
    with options.out.open("a") as file:
        file.write(json.dumps(row) + "\n")
    print(json.dumps(row))


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("stage", choices=tuple(STAGES))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--set", nargs="*", default=[], metavar="NAME=VALUE")
    parser.add_argument("--high-level", type=Path, help="folder of an earlier --keep")
    parser.add_argument("--keep", type=Path, help="where to store the weights")
    parser.add_argument("--out", type=Path, default=Path("results/search.jsonl"))
    return parser.parse_args()


if __name__ == "__main__":
    main()
