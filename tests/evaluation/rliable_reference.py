"""Makes `rliable_reference.json`: what the authors' package says of small tables of scores.

In a virtual environment of its own (rliable 1.2.0 needs pandas below 3 through arch):

    python -m venv /tmp/rliable && /tmp/rliable/bin/pip install rliable==1.2.0 "pandas<3"
    /tmp/rliable/bin/python tests/evaluation/rliable_reference.py

One table is real: the reward of the ten seeds of `results/quick.json`, in both worlds. The others
are drawn here, two of them rounded so that scores are equal within and between arms. Takes about
a minute.
"""

import json
import platform
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

import numpy as np
from rliable import library, metrics

HERE = Path(__file__).resolve().parent
STUDY = HERE.parents[1] / "results" / "quick.json"
WORLDS = ("lanewise", "highway_env")
IQM_RESAMPLES = 20_000
IMPROVEMENT_RESAMPLES = 5_000
"""Fewer, as rliable calls scipy once a task and resample."""


def main():
    tables = make_tables()
    pairs = [("drawn, 5 seeds", "drawn, 7 seeds"), ("rounded, 6 seeds", "rounded, 4 seeds")]
    stored = {
        "origin": {
            "package": "rliable",
            "source": "https://github.com/google-research/rliable",
            "command": "python tests/evaluation/rliable_reference.py",
            "date": datetime.now(UTC).date().isoformat(),
            "versions": {name: version(name) for name in ("rliable", "arch", "numpy", "scipy")}
            | {"python": platform.python_version()},
            "resamples": {
                "interquartile_mean": IQM_RESAMPLES,
                "probability_of_improvement": IMPROVEMENT_RESAMPLES,
            },
        },
        "tables": {name: table.tolist() for name, table in tables.items()},
        "interquartile_mean": {name: iqm(table) for name, table in tables.items()},
        "probability_of_improvement": [
            {"scores": x, "others": y, **improvement(tables[x], tables[y])} for x, y in pairs
        ],
    }
    (HERE / "rliable_reference.json").write_text(json.dumps(stored, indent=1) + "\n")


def make_tables():
    """Scores, [seeds, tasks] each."""
    rng = np.random.default_rng(0)
    rows = json.loads(STUDY.read_text())["rows"]
    return {
        "quick.json, both worlds": np.array(
            [[row[world]["accumulated_reward"] for world in WORLDS] for row in rows]
        ),
        "quick.json, ours alone": np.array(
            [[row["lanewise"]["accumulated_reward"]] for row in rows]
        ),
        "drawn, 5 seeds": rng.normal(0.5, 1.0, (5, 3)),
        "drawn, 7 seeds": rng.normal(0.0, 1.0, (7, 3)),
        "rounded, 6 seeds": rng.normal(1.0, 1.0, (6, 2)).round(),
        "rounded, 4 seeds": rng.normal(0.0, 1.5, (4, 2)).round(),
    }


def iqm(table):
    return _estimate(table, lambda scores: np.array([metrics.aggregate_iqm(scores)]), IQM_RESAMPLES)


def improvement(scores, others):
    return _estimate(
        (scores, others),
        lambda x, y: np.array([metrics.probability_of_improvement(x, y)]),
        IMPROVEMENT_RESAMPLES,
    )


def _estimate(scores, statistic, resamples):
    # rliable draws from numpy's global state, whatever `random_state` it is given.
    np.random.seed(0)
    value, interval = library.get_interval_estimates({"_": scores}, statistic, reps=resamples)
    return {"value": float(value["_"][0]), "interval": interval["_"][:, 0].tolist()}


if __name__ == "__main__":
    main()
