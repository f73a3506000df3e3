"""1,000 updates of every controller's learner against a reference in NumPy, in double precision.

    python campaigns/learner.py --out results/trust/learner.json

The transitions are those that the controllers' own training drives write to their replays; the
settings are those of each level in each preset, and some that presets leave alone. Both sides see
the same batches. An error is the largest difference in an array, over the largest number in it.
Training enlarges errors of rounding, so the reference is also held against itself with the rows of
each batch in another order, which is what rounding alone comes to. Stopped, the same command goes
on.
"""

import argparse
import json
import sys
from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import record
from learner_reference import Reference

from lanewise import config
from lanewise.controllers.registry import STEP_1, STEP_2
from lanewise.learning import learner, network
from lanewise.learning.replay import Transition
from lanewise.system.progress import Progress
from lanewise.training import recipe, stage

STAGES = (STEP_1, STEP_2, *recipe.RECIPES["single-level"], *recipe.RECIPES["h-dqn"])
UPDATES, LIMIT = 1000, 1e-10
DRIVES = 4
"""Chunks driven to gather transitions."""
SHORT = {
    "worlds": 16,
    "learner.warm_up": 10_000_000,
    "learner.hidden": (16,),
    "learner.replay_capacity": 20_000,
}
"""What the drive is not to take from the preset: nothing that a transition depends on."""
CHANGES = {
    "": {},
    "plain": {"double": False},
    "hard copy": {"target_update": "hard-copy"},
    "falling rate": {"learning_rate_decay": 600},
}
"""Of the learner; what they ask for is in a preset already or in none."""


def transitions(settings, of_stage, seed=0):
    """By level that learns, the rows its replay holds after a drive with random choices."""
    course = recipe.course(settings, of_stage)
    short = {key.removeprefix("learner."): value for key, value in SHORT.items()}
    budget = replace(course.budget, worlds=short.pop("worlds"))
    learning = tuple(
        (
            name,
            replace(
                how,
                learner=replace(how.learner, **short),
                exploration=replace(how.exploration, start=0.5, end=0.5),
            ),
        )
        for name, how in course.learning
    )
    course = replace(course, budget=budget, learning=learning)
    key = jax.random.key(seed)
    frozen = {
        level.name: network.init(key, level.feature_count, (16,), level.choice_count)
        for level in course.leading
    }
    state = stage.begin(course, frozen, key)
    for _ in range(DRIVES):
        state, _ = stage.advance(course, frozen, state)
    return {
        name: np.asarray(memory.rows[: int(memory.filled)], np.float64)
        for name, memory in state.replays.items()
    }


def batches(rows, size, count, seed):
    """Batches of transitions, drawn with replacement, in double precision."""
    rng = np.random.default_rng(seed)
    inputs = (rows.shape[1] - 3) // 2
    for _ in range(count):
        drawn = rows[rng.integers(len(rows), size=size)]
        yield Transition(
            features=drawn[:, :inputs],
            action=drawn[:, inputs].astype(np.int32),
            reward=drawn[:, inputs + 1],
            discount=drawn[:, inputs + 2],
            next_features=drawn[:, inputs + 3 :],
        )


def compare(settings, rows, actions, updates=UPDATES, seed=0, tell=lambda done: None):
    """Largest relative errors of loss, online and target network, and the smallest margin.

    ``reordered`` is the largest error in a network of the reference with the rows of each batch in
    another order, against itself: what rounding alone comes to.

    Args:
        settings: of the learner.
        rows: transitions, as a replay holds them.
        actions: number of actions.
        updates: how many.
        seed: of weights and batches.
        tell: called after every update with their number.
    """
    with jax.enable_x64(True):
        step = jax.jit(partial(learner.update, settings))
        state = learner.begin(jax.random.key(seed), settings, (rows.shape[1] - 3) // 2, actions)
        state = jax.tree.map(_double, state)
        reference, reordered = (Reference(settings, state.online) for _ in range(2))
        rng = np.random.default_rng(seed)
        losses = []
        for number, batch in enumerate(batches(rows, settings.batch_size, updates, seed), start=1):
            state, metrics = step(state, jax.tree.map(jnp.asarray, batch))
            losses.append(float(metrics.loss))
            reference.update(batch)
            order = rng.permutation(len(batch.action))
            reordered.update(jax.tree.map(lambda part, order=order: part[order], batch))
            tell(number)
        assert state.online[0][0].dtype == np.float64
        return {
            "loss": float(np.max(np.abs(np.divide(losses, reference.losses) - 1.0))),
            "online": _error(state.online, reference.online),
            "target": _error(state.target, reference.target),
            "reordered": _error(
                (*reordered.online, *reordered.target), (*reference.online, *reference.target)
            ),
            "smallest_margin": min(reference.margins),
            "last_loss": losses[-1],
        }


def _double(leaf):
    return leaf.astype(np.float64) if jnp.issubdtype(leaf.dtype, jnp.floating) else leaf


def _error(ours, theirs):
    """Over all arrays, the largest difference over the largest number; NaN if there is any."""
    errors = [
        np.abs(np.asarray(a) - b).max() / np.abs(b).max()
        for ours_of, theirs_of in zip(ours, theirs, strict=True)
        for a, b in zip(ours_of, theirs_of, strict=True)
    ]
    return float(np.max(errors))


def worst_of(row):
    """The largest error of a comparison; NaN, which is within no limit, if there is any.

    Python's own ``max`` would pass over NaN.
    """
    return float(np.max([row["loss"], row["online"], row["target"]]))


def measure(preset, of_stage, options, reporter):
    """A row for every level that learns in a stage, and every change."""
    settings = config.compose(preset=preset)
    found = []
    driven = transitions(settings, of_stage, options.seed)
    for name, how in recipe.learning(settings, of_stage):
        actions = recipe.course(settings, of_stage).level(name).choice_count
        for change, values in CHANGES.items():
            if change and preset != "quick":
                continue
            shape = replace(how.learner, hidden=tuple(options.hidden), **values)
            label = " ".join(filter(None, (preset, of_stage.name, name, change)))
            reporter.stage(label, options.updates)
            row = compare(
                shape, driven[name], actions, options.updates, options.seed, reporter.update
            )
            worst = worst_of(row)
            reporter.note(f"{label}: {worst:.1e}")
            about = {"preset": preset, "stage": of_stage.name, "level": name, "change": change}
            found.append(
                about
                | {
                    "features": (driven[name].shape[1] - 3) // 2,
                    "transitions": len(driven[name]),
                    "discounts": sorted(set(driven[name][:, -_inputs(driven[name]) - 1]))[:8],
                }
                | row
                | {"worst": worst}
            )
    return found


def _inputs(rows):
    return (rows.shape[1] - 3) // 2


def main():
    """Compare, store what came of it, and tell by the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--updates", type=int, default=UPDATES)
    parser.add_argument("--hidden", type=int, nargs="+", default=[512, 512])
    parser.add_argument("--presets", nargs="+", default=["quick", "paper", "ranges"])
    parser.add_argument("--only", nargs="+", help="names of stages")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--work", type=Path, default=record.ROOT / "build")
    parser.add_argument("--out", type=Path, default=Path("results/trust/learner.json"))
    options = parser.parse_args()
    kept = Kept(options.work / "learner.json", options)
    rows = []
    with Progress() as reporter:
        for preset, of_stage in product(options.presets, STAGES):
            if options.only and of_stage.name not in options.only:
                continue
            rows += kept.get(
                f"{preset} {of_stage.name}",
                partial(measure, preset, of_stage, options, reporter),
            )
    worst = float(np.max([row["worst"] for row in rows]))
    figures = {"updates": options.updates, "hidden": options.hidden, "limit": LIMIT}
    record.store(options.out, figures | {"worst": worst, "rows": rows}, options.seed, ("optax",))
    print(f"{len(rows)} learners, {options.updates} updates each: largest error {worst:.1e}")
    return int(not worst <= LIMIT)


class Kept:
    """Rows on disk by preset and stage, as long as all that they depend on is what it was."""

    def __init__(self, path, options):
        numbers = (options.updates, options.hidden, options.seed)
        self.path = path
        self.state = record.state(numbers, within=("src", "campaigns"), packages=("optax",))
        known = json.loads(path.read_text()) if path.exists() else {}
        self.rows = known["rows"] if known.get("state") == self.state else {}

    def get(self, name, make):
        """The rows of a name, made and kept if there are none yet."""
        if name not in self.rows:
            self.rows[name] = make()
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self.path.write_text(json.dumps({"state": self.state, "rows": self.rows}))
        return self.rows[name]


if __name__ == "__main__":
    sys.exit(main())
