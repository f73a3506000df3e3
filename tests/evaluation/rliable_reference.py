"""Makes `rliable_reference.json`: what the authors' package says of made-up scores.

In a virtual environment of its own (rliable 1.2.0 needs pandas below 3 through arch):

    python -m venv /tmp/rliable && /tmp/rliable/bin/pip install rliable==1.2.0 "pandas<3"
    /tmp/rliable/bin/python tests/evaluation/rliable_reference.py

Scores of two arms are rounded, so that some are equal within and between them. Takes about half a
minute.
"""

import json
import platform
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

import numpy as np
from rliable import library, metrics

RESAMPLES = 20_000
RNG = np.random.default_rng(0)
SCORES = {
    "12 seeds": RNG.normal(0.5, 1.0, 12),
    "9 seeds": RNG.normal(0.0, 1.0, 9),
    "11 rounded seeds": RNG.normal(1.0, 1.0, 11).round(),
    "8 rounded seeds": RNG.normal(0.0, 1.5, 8).round(),
}


def main():
    pairs = [("12 seeds", "9 seeds"), ("11 rounded seeds", "8 rounded seeds")]
    stored = {
        "origin": {
            "package": "rliable",
            "source": "https://github.com/google-research/rliable",
            "command": "python tests/evaluation/rliable_reference.py",
            "date": datetime.now(UTC).date().isoformat(),
            "versions": {name: version(name) for name in ("rliable", "arch", "numpy", "scipy")}
            | {"python": platform.python_version()},
            "resamples": RESAMPLES,
        },
        "scores": {name: scores.tolist() for name, scores in SCORES.items()},
        "cases": [estimate(name) for name in SCORES] + [estimate(*pair) for pair in pairs],
    }
    path = Path(__file__).with_suffix(".json")
    path.write_text(json.dumps(stored, indent=1) + "\n")


def estimate(*arms):
    """The interquartile mean of one arm, or how likely one improves on another."""
    statistic = metrics.aggregate_iqm if len(arms) == 1 else metrics.probability_of_improvement
    tables = [SCORES[name][:, None] for name in arms]
    # rliable draws from numpy's global state, whatever `random_state` it is given.
    np.random.seed(0)
    value, interval = library.get_interval_estimates(
        {"_": tables[0] if len(arms) == 1 else tuple(tables)},
        lambda *scores: np.array([statistic(*scores)]),
        reps=RESAMPLES,
    )
    return {"arms": arms, "value": float(value["_"][0]), "interval": interval["_"][:, 0].tolist()}


if __name__ == "__main__":
    main()
