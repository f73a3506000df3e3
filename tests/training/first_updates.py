"""The first 200 updates of every training, in a few numbers that other processors agree on.

    python tests/training/first_updates.py

writes `src/lanewise/first_updates.json` anew. Do that only when training is meant to change:
results trained before are stale from then on, and `python docs/make_results.py` makes every page
say so until they are made again.
"""

import json
import sys

import jax
import numpy as np

from lanewise import config
from lanewise.controllers.registry import CONTROLLERS
from lanewise.system.version import FIRST_UPDATES
from lanewise.training import recipe, stage

UPDATES = 200
SEED = 1
ARMS = {
    "step-1": ("planned", {}),
    "step-2": ("hierarchical", {}),
    "single-level": ("single-level", {}),
    "single-level-held": ("single-level", {"single_level.hold": 5}),
    "h-dqn": ("h-dqn", {}),
}
"""Controller, whose last stage is trained, and what differs from the default settings."""


def first_updates(arm):
    """What an arm's last stage computes until each of its learners has made 200 updates.

    Levels below it are frozen as they begin, so nothing else has to be trained before.
    """
    controller, flags = ARMS[arm]
    settings = config.compose(flags=flags)
    *earlier, last = CONTROLLERS[controller].stages
    frozen = {}
    for each in earlier:
        begun = stage.begin(recipe.stage_config(settings, each), frozen, jax.random.key(0))
        frozen = frozen | stage.online(begun.learners)
    course = recipe.stage_config(settings, last)
    state, chunks = stage.begin(course, frozen, jax.random.key(SEED)), []
    while not chunks or min(level["updates"] for level in chunks[-1]["levels"].values()) < UPDATES:
        state, metrics = stage.advance(course, frozen, state)
        chunks.append(_chunk(jax.device_get(metrics)))
    weights = {
        name: _matrices(parameters) for name, parameters in stage.online(state.learners).items()
    }
    return {"chunks": chunks, "mean_size_of_weights": weights}


def _chunk(metrics):
    done = metrics.episodes.outcome.over
    return {
        "episodes": int(done.sum()),
        "accidents": int((metrics.episodes.outcome.accident[done] > 0).sum()),
        "reward": float(metrics.episodes.reward[done].sum()),
        "levels": {
            name: {field: value.item() for field, value in vars(level).items()}
            for name, level in metrics.levels.items()
        },
    }


def _matrices(parameters):
    """Mean size of each weight matrix; biases are few and small, and part ways sooner."""
    leaves = map(np.asarray, jax.tree.leaves(parameters))
    return [float(np.abs(leaf).mean()) for leaf in leaves if leaf.ndim == 2]


def main():
    """Write the file."""
    found = {}
    for arm in ARMS:
        sys.stdout.write(f"{arm}\n")
        found[arm] = first_updates(arm)
    FIRST_UPDATES.write_text(json.dumps(found, indent=1) + "\n", "utf-8")


if __name__ == "__main__":
    main()
