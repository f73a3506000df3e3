"""Test trained controllers under every variation that docs/driver.md lists, for 25, 60 and 120 s.

    python benchmarks/driver.py runs/driver/seed-0 --out results/driver/rows.json

Every row changes some settings of the paper's test start. Episode i of a row is start i of the
seed, as in ``lanewise evaluate``. One drive of 120 s is judged at each horizon: an accident counts
from the horizon on by which it has happened. The file holds the counts, by kind of accident too.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

sys.path.append(str(Path(__file__).parents[1] / "campaigns"))
import record

from lanewise import config
from lanewise.evaluation import evaluator
from lanewise.evaluation.cells import KINDS, CellOutcome, outcome
from lanewise.evaluation.conditions import HORIZONS, JUDGED
from lanewise.evaluation.statistics import clopper_pearson
from lanewise.experiments import evaluate_trained
from lanewise.report import tables
from lanewise.runs import trained
from lanewise.runs.trained import Trained

EGO, TRAP, LANES = "scenario.ego_speed", "scenario.trap_speed", "scenario.lanes"
TRAFFIC, DRIVER = "scenario.traffic", "scenario.traffic.driver"


def _driver(times: float, **others: float) -> dict[str, object]:
    """Traffic whose IDM has so many times the paper's a and b; the limit stays 1 m/s^2."""
    sizes = dict.fromkeys(("comfort_acceleration", "comfort_deceleration"), 0.5 * times)
    return {f"{DRIVER}.{name}": value for name, value in (sizes | others).items()}


def _traffic_at(speed: float) -> dict[str, object]:
    return {f"{TRAFFIC}.speed": speed, f"{DRIVER}.target_speed": speed}


BEHIND: dict[str, object] = {f"{TRAFFIC}.vehicles_behind": 6}
ROWS: dict[str, dict[str, object]] = {
    "the paper's test start": {},
    **{f"ego {speed:g} m/s": {EGO: speed} for speed in (8.0, 9.0, 11.0, 12.0, 13.0)},
    **{f"trap {speed:g} m/s": {TRAP: speed} for speed in (8.0, 9.0, 10.9, 11.0)},
    **{f"{number} lanes": {LANES: number} for number in (2, 4, 5)},
    **{f"traffic every {gap:g} m": {f"{TRAFFIC}.spacing": gap} for gap in (17.0, 15.0)},
    "no traffic at all": {f"{TRAFFIC}.vehicles_ahead": 0},
    "aggressive traffic (a, b x 2)": _driver(2.0),
    "aggressive traffic (x 4, politeness 0)": _driver(4.0, politeness=0.0),
    "6 vehicles behind": BEHIND,
    "all traffic 15 m/s, 6 behind": BEHIND | _traffic_at(15.0),
    "all traffic 11 m/s": _traffic_at(11.0),
    "D2 = 0": {"scenario.test_side_distance": 0.0},
    "noise 0.05 on every feature": {"driving.observation.noise": 0.05},
    "noise 0.1 on every feature": {"driving.observation.noise": 0.1},
    "latency 0.2 s": {"driving.latency": 0.2},
}
"""What each row changes in the paper's test."""
PAPER = next(iter(ROWS))


def test(run: Trained, row: str, episodes: int, seed: int) -> CellOutcome:
    """What came of a row's episodes at each horizon."""
    changes = ROWS[row] | {"evaluation.duration": HORIZONS[-1]}
    changed = replace(run, settings=config.replace(run.settings, changes))
    rules = evaluate_trained.evaluation_config(changed)
    found = evaluator.evaluate(rules, run.parameters, seed, episodes)
    return outcome(found, HORIZONS)


def paper_means(run: Trained, episodes: int, seed: int) -> dict[str, float]:
    """Means of the paper's own test of 25 s: its reward, m/s and m."""
    changed = replace(run, settings=config.replace(run.settings, {"evaluation.duration": 25}))
    rules = evaluate_trained.evaluation_config(changed)
    found = evaluator.evaluate(rules, run.parameters, seed, episodes)
    names = ("accumulated_reward", "average_speed", "travel_distance")
    return {name: float(getattr(found, name).mean()) for name in names}


def line(row: str, found: CellOutcome) -> list[str]:
    """A row of the table: success and accidents in % by horizon, the latter's upper bound."""
    cells = [row]
    for horizon in range(len(HORIZONS)):
        counts = found.at(horizon)
        high = 100 * clopper_pearson(counts.accidents, counts.episodes)[1]
        rates = (100 * counts.rate(name) for name in ("successes", "accidents"))
        cells.append("{:.2f} / {:.2f}".format(*rates) + f" (< {high:.2f})")
    kinds = dict(zip(KINDS, found.kinds[JUDGED], strict=True))
    return [*cells, ", ".join(f"{kind} {count}" for kind, count in kinds.items() if count)]


def main(words: Sequence[str] | None = None) -> None:
    """Tests, prints a table for each run, and stores everything."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("runs", nargs="+", metavar="RUN")
    parser.add_argument("--episodes", type=int, default=10_000)
    parser.add_argument("--paper-episodes", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, required=True)
    asked = parser.parse_args(words)
    stored: dict[str, Any] = {}
    for path in asked.runs:
        run, outcomes = trained.load(Path(path)), {}
        for row in ROWS:
            count = asked.paper_episodes if row == PAPER else asked.episodes
            outcomes[row] = test(run, row, count, asked.seed)
            sys.stderr.write(f"{path}: {' | '.join(line(row, outcomes[row]))}\n")
        means = paper_means(run, asked.paper_episodes, asked.seed)
        stored[path] = {
            "training_seed": run.seed,
            "paper_means": means,
            "rows": {row: asdict(found) for row, found in outcomes.items()},
        }
        head = ["success / accidents, %", *(f"{second} s" for second in HORIZONS), "kinds, 60 s"]
        print(tables.markdown(head, [line(row, found) for row, found in outcomes.items()]))
        print(", ".join(f"{name} {value:.2f}" for name, value in means.items()), flush=True)
        figures = {"horizons": HORIZONS, "kinds": KINDS, "runs": stored}
        record.store(asked.out, figures, asked.seed)


if __name__ == "__main__":
    main()
