"""Take a finished run into the package as a pretrained controller, with where it comes from.

    python docs/make_pretrained.py RUN NAME
    python docs/make_pretrained.py out/runs/hierarchical hierarchical

Of a folder of runs it takes the one whose weights did best on validation starts. Copies the run's
settings and weights, not its metrics, and writes `provenance.json`: the training seed, the
validation figures by which its weights were chosen, those of the other runs, its tests where the
run folder has them, versions, machine and date.
"""

import json
import shutil
import sys
from pathlib import Path
from typing import Any

from lanewise.report import provenance
from lanewise.runs import metrics_file, pretrained, selected_weights, trained

KEPT = ("run.json", "settings.toml", "controller.json", "controller.safetensors")


def main() -> None:
    """Copy the run and write its provenance."""
    source, name = Path(sys.argv[1]), sys.argv[2]
    runs = [source] if (source / "run.json").exists() else sorted(source.glob("seed-*"))
    found = {run: chosen_by(run) for run in runs}
    last = {run.name: list(stages.values())[-1] for run, stages in found.items()}
    run = max(runs, key=lambda run: last[run.name]["score"])
    controller = trained.load(run)
    target = pretrained.PRETRAINED / name
    target.mkdir(parents=True, exist_ok=True)
    for file in KEPT:
        shutil.copyfile(run / file, target / file)
    story = {
        "controller": controller.name,
        "seed": controller.seed,
        "run": json.loads((run / "run.json").read_text()),
        "validation": found[run],
        "candidates": last,
        "tests": {path.stem: json.loads(path.read_text()) for path in run.glob("tests/*.json")},
        **provenance.origin(),
    }
    (target / "provenance.json").write_text(json.dumps(story, indent=1) + "\n")
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


if __name__ == "__main__":
    main()
