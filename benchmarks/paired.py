"""Drive trained controllers from the same starts in our world and in the real highway-env.

    python benchmarks/paired.py pretrained/driver --episodes 300 --seconds 60 \
        --out results/driver/highway-env.json

Episode i is start i of the seed in both, as in ``lanewise evaluate``. Two episodes end alike if
both succeed or neither, and both end by the same kind of accident or none. The file names those
that do not.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

sys.path.append(str(Path(__file__).parents[1] / "campaigns"))
import record

from lanewise import config
from lanewise.evaluation import metrics
from lanewise.evaluation.settings import WORLDS
from lanewise.experiments import evaluate_trained
from lanewise.runs import trained
from lanewise.runs.trained import Trained
from lanewise.system.progress import Progress


def test(run: Trained, seconds: int, episodes: int, seed: int) -> dict[str, Any]:
    """What came of the episodes in each world, and how many pairs ended alike."""
    settings = config.replace(run.settings, {"evaluation.duration": seconds})
    with Progress() as reporter:
        found = [
            evaluate_trained.evaluate(
                replace(run, settings=settings), world, episodes, seed, reporter
            )
            for world in WORLDS
        ]
    summaries = [
        metrics.summarise(each, controller=run.name, world=world).to_json()
        for world, each in zip(WORLDS, found, strict=True)
    ]
    return {"paired": metrics.paired(*found).to_json(), "tests": summaries}


def main(words: Sequence[str] | None = None) -> None:
    """Test each, print how many pairs ended alike, and store everything."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("runs", nargs="+", metavar="RUN")
    parser.add_argument("--episodes", type=int, default=300)
    parser.add_argument("--seconds", type=int, default=60)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, required=True)
    asked = parser.parse_args(words)
    stored: dict[str, Any] = {}
    for path in asked.runs:
        run = trained.load(Path(path))
        stored[path] = test(run, asked.seconds, asked.episodes, asked.seed)
        pairs = stored[path]["paired"]
        print(f"{path}: {pairs['identical']} of {pairs['episodes']} end alike", flush=True)
        record.store(asked.out, {"seconds": asked.seconds, "runs": stored}, asked.seed)


if __name__ == "__main__":
    main()
