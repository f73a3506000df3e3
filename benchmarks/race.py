"""Search settings for the flat controller and h-DQN, with as many runs as the hierarchical one had.

    python benchmarks/race.py --out race

The hierarchical controller's settings were chosen in 37 trainings (`results/search.json`, without
those of h-DQN and of preset `ranges`). Here each of the two others gets as many: 25 settings with
one seed, the defaults and 24 drawn from `SPACES`; then the best four with three seeds more. All
have the budget of preset `quick`, and a step size that falls over as many updates as they make.
What counts is the score of the kept weights on 1,000 validation starts by which no weights were
chosen; the test start is not looked at. The same command continues what was stopped.
`race/race.json` holds every training.
"""

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).parents[1] / "campaigns"))
import record

from lanewise import config
from lanewise.experiments import schedule
from lanewise.experiments.jobs import Job
from lanewise.runs import metrics_file, run_state, selected_weights
from lanewise.runs.run_folder import RunFolder
from lanewise.system import folder_io, process

SPACES: dict[str, dict[str, Sequence[object]]] = {
    "single-level": {
        "single_level.hold": (1, 2, 3, 5, 8),
        "single_level.learner.discount": (0.8, 0.9, 0.95, 0.97, 0.99),
        "single_level.returns": (1, 3, 5),
        "single_level.updates_per_step": (0.125, 0.25, 0.5),
        "single_level.duration": (60, 120, 250),
    },
    "h-dqn": {
        "goals.time_limit": (2.0, 3.0, 4.0, 6.0),
        "h_dqn.high_level.learner.discount": (0.8, 0.9, 0.95),
        "h_dqn.low_level.learner.discount": (0.8, 0.9, 0.95, 0.99),
        "h_dqn.low_level.returns": (1, 3),
        "h_dqn.high_level.updates_per_step": (0.0625, 0.125, 0.25),
        "h_dqn.low_level.updates_per_step": (0.125, 0.25, 0.5),
        "h_dqn.duration": (60, 120, 250),
    },
}
"""By controller, the settings that are searched, and their values."""
DRAWN, BEST, MORE_SEEDS = 24, 4, (1, 2, 3)
RATIO, DECAY = "updates_per_step", "learner.learning_rate_decay"


@dataclass(frozen=True)
class Training(Job):
    """A training that is not tested."""

    @property
    def done(self) -> bool:
        return (self.path / "controller.json").exists()


def main() -> None:
    """Race both controllers and write down every training."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder of the runs and race.json")
    parser.add_argument("--controllers", nargs="+", choices=SPACES, default=list(SPACES))
    parser.add_argument("--processes", type=int, default=len(process.usable_cores()))
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    for controller in options.controllers:
        tried = range(len(settings_of(controller)))
        race(options, [training(options.out, controller, number, 0) for number in tried])
        firsts = [training(options.out, controller, number, 0).path for number in tried]
        ranked = sorted(tried, key=lambda number: -weights_of(firsts[number]).score)
        race(
            options,
            [
                training(options.out, controller, number, seed)
                for number in ranked[:BEST]
                for seed in MORE_SEEDS
            ],
        )


def settings_of(controller: str) -> list[dict[str, object]]:
    """What is tried: the defaults, and settings drawn without repetition, always the same ones."""
    rng, space = np.random.default_rng(0), SPACES[controller]
    defaults = config.flatten(config.compose())
    found = [{name: defaults[name] for name in space}]
    while len(found) <= DRAWN:
        changes = {name: values[rng.integers(len(values))] for name, values in space.items()}
        if changes not in found:
            found.append(changes)
    return [changes | _decays(changes, defaults) for changes in found]


def _decays(changes: Mapping[str, object], defaults: Mapping[str, object]) -> dict[str, object]:
    """Updates over which the step size falls: by default as many as there are in all."""
    return {
        (decay := name.replace(RATIO, DECAY)): round(defaults[decay] * value / defaults[name])
        for name, value in changes.items()
        if name.endswith(RATIO)
    }


def training(out: Path, controller: str, number: int, seed: int) -> Training:
    """One of the race."""
    return Training(
        arm=f"{controller} {number:02d}",
        controller=controller,
        trains=True,
        settings=config.compose(flags=settings_of(controller)[number]),
        seed=seed,
        path=out / controller / f"{number:02d}" / f"seed-{seed}",
        high_level=None,
        episodes={},
    )


def race(options: argparse.Namespace, runs: Sequence[Training]) -> None:
    """Train what is left, as many at once as there are cores; then write the record."""
    with folder_io.lock(options.out, "racing") as out:
        schedule.run(runs, options.processes, sys.stderr, out)
    write(options.out)


def weights_of(path: Path) -> selected_weights.SelectedWeights:
    """The weights that a finished training kept, on fresh validation starts."""
    return selected_weights.of_run(metrics_file.read(path / "metrics.jsonl"))[-1]


def write(out: Path) -> None:
    """The record of every training that is finished."""
    rows = []
    for path in sorted(path.parent for path in out.glob("*/*/seed-*/controller.json")):
        controller, number, seed = path.parts[-3:]
        folder, weights = RunFolder.open(path), weights_of(path)
        rows.append(
            {
                "controller": controller,
                "number": int(number),
                "changes": settings_of(controller)[int(number)],
                "seed": int(seed.removeprefix("seed-")),
                "score": weights.score,
                **{name: value for name, value in weights.line.items() if "_" in name},
                "trained_by": dict(folder.source),
                "weights_sha256": run_state.weights_digest(folder),
            }
        )
    what = (
        "Settings of the flat controller and of h-DQN, searched as long as those of the "
        "hierarchical one: benchmarks/race.py says how."
    )
    record.store(out / "race.json", {"what": what, "spaces": SPACES, "rows": rows})


if __name__ == "__main__":
    main()
