"""Take a finished run into the package as a pretrained controller, with where it comes from.

    python docs/make_pretrained.py RUN NAME
    python docs/make_pretrained.py out/runs/hierarchical hierarchical
    python docs/make_pretrained.py runs/driver driver --choose median

Of a folder of runs it takes the one whose weights did best on fresh validation starts, or the
median one. With ``--add`` the candidates of the controller of that name count too: their figures
are in its provenance, and their folders need no metrics. Copies the run's settings and weights, not
its metrics, and writes `provenance.json`: the training seed, the figures of all runs on those
starts, tests, versions, machine and date. A run folder without tests is tested here, as `lanewise
evaluate` does, with its own settings.
"""

import argparse
import json
import shutil
import sys
from pathlib import Path
from typing import Any

from lanewise.evaluation import metrics
from lanewise.experiments import evaluate_trained
from lanewise.report import provenance
from lanewise.runs import metrics_file, pretrained, selected_weights, trained
from lanewise.runs.trained import Trained
from lanewise.system.progress import Progress

KEPT = ("run.json", "settings.toml", "controller.json", "controller.safetensors")
PROVENANCE = "provenance.json"
EPISODES = 1000


def main() -> None:
    """Copy the run and write its provenance."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path, metavar="RUN")
    parser.add_argument("name", metavar="NAME")
    parser.add_argument("--choose", choices=("best", "median"), default="best")
    parser.add_argument("--add", action="store_true")
    asked = parser.parse_args()
    source, target = asked.run, pretrained.PRETRAINED / asked.name
    before = json.loads((target / PROVENANCE).read_text()) if asked.add else {}
    runs = [source] if (source / "run.json").exists() else sorted(source.glob("seed-*"))
    found = {run.name: chosen_by(run) for run in runs if (run / "metrics.jsonl").exists()}
    last = before.get("candidates", {}) | {
        name: list(stages.values())[-1] for name, stages in found.items()
    }
    ordered = sorted(runs, key=lambda run: last[run.name]["score"])
    run = ordered[-1] if asked.choose == "best" else ordered[(len(ordered) - 1) // 2]
    controller, origin = trained.load(run), provenance.origin()
    target.mkdir(parents=True, exist_ok=True)
    for file in KEPT:
        shutil.copyfile(run / file, target / file)
    tests = {path.stem: json.loads(path.read_text()) for path in run.glob("tests/*.json")}
    story = {
        "controller": controller.name,
        "seed": controller.seed,
        "run": json.loads((run / "run.json").read_text()),
        "chosen": asked.choose,
        "validation": found.get(run.name) or {list(before["validation"])[-1]: last[run.name]},
        "candidates": dict(sorted(last.items())),
        "tests": tests or {"lanewise": {"summary": tested(controller)}},
        **origin,
    }
    (target / PROVENANCE).write_text(json.dumps(story, indent=1) + "\n")
    size = sum(path.stat().st_size for path in target.iterdir()) / 1e6
    sys.stdout.write(f"{run} to {target}: {size:.1f} MB\n")


def chosen_by(run: Path) -> dict[str, dict[str, Any]]:
    """How the weights that each stage kept do on fresh validation starts, by stage."""
    return {
        weights.stage: {
            f"validation_{name.removeprefix('kept_')}": value
            for name, value in weights.line.items()
            if name.startswith("kept_") and name != "kept_chunk"
        }
        | {"score": weights.score}
        for weights in selected_weights.of_run(metrics_file.read(run / "metrics.jsonl"))
    }


def tested(controller: Trained) -> dict[str, Any]:
    """A test with its own settings, from the starts of its training seed."""
    with Progress() as reporter:
        episodes = evaluate_trained.evaluate(
            controller, "lanewise", EPISODES, controller.seed, reporter
        )
    found = metrics.summarise(episodes, controller=controller.name, world="lanewise")
    return found.to_json()


if __name__ == "__main__":
    main()
