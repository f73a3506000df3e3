"""Compare exported policies with their controllers over the states that the controllers visit.

python benchmarks/export.py --decisions 10000 --out results/export.json

Trained controllers drive from training starts in their own settings, untrained ones over the starts
of preset `driver`: other speeds, and 2 to 5 lanes. An untrained controller's first layer is made
larger, so that its choices vary.
"""

import argparse
import sys
import tempfile
from pathlib import Path

import jax

sys.path.append(str(Path(__file__).parents[1] / "campaigns"))
import record

from lanewise import config
from lanewise.controllers.settings import RENEWALS
from lanewise.export import check, contents, formats
from lanewise.learning import network
from lanewise.runs import trained
from lanewise.runs.trained import Trained
from lanewise.training import recipe

HIDDEN, ENLARGED = (256, 256), 8.0


def untrained(name, seed, **flags):
    """A controller with random weights."""
    settings = config.compose(preset="driver", trap="trap-10", file=None, flags=flags)
    parameters = {}
    for number, level in enumerate(recipe.evaluation_config(settings, name).controller.levels):
        key = jax.random.fold_in(jax.random.key(seed), number)
        first, *rest = network.init(key, level.feature_count, HIDDEN, level.choice_count)
        parameters[level.name] = (tuple(ENLARGED * array for array in first), *rest)
    return Trained(name, settings, seed, parameters)


def cases(seed):
    """(what it is, controller, when goals are renewed) of each comparison."""
    hierarchical = trained.load(Path("pretrained/hierarchical"))
    for renewal in RENEWALS:
        yield f"pretrained/hierarchical, renewal {renewal}", hierarchical, renewal
    high_level = {"high_level": hierarchical.parameters["high_level"]}
    planned = Trained("planned", hierarchical.settings, hierarchical.seed, high_level)
    yield "the high level of pretrained/hierarchical above the planner", planned, None
    yield "pretrained/single-level", trained.load(Path("pretrained/single-level")), None
    for name, flags in {
        "h-dqn": {},
        "planned": {},
        "hierarchical": {"goals.reference": "current-state", "goals.action_set": "joint-6"},
        "single-level": {"single_level.hold": 5},
    }.items():
        changes = "".join(f", {setting} = {value}" for setting, value in flags.items())
        yield f"untrained {name}{changes}", untrained(name, seed, **flags), None


def measure(decisions, seed, chosen=range(9)):
    """One row for each controller and format."""
    rows = []
    for number, (what, controller, renewal) in enumerate(cases(seed)):
        if number not in chosen:
            continue
        policy = contents.policy(controller, config.digest(controller.settings), renewal)
        for ending in (formats.NUMPY, formats.ONNX):
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder) / f"policy{ending}"
                formats.save(policy, path)
                step = formats.read(path).step
                found = check.agreement(controller, step, decisions, seed, renewal)
            rows.append({"controller": what, "format": ending} | found.to_json())
            print(f"{what}, {ending}: {found}", flush=True)
    return rows


def main():
    """Compare, and store the result."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--decisions", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("results/export.json"))
    arguments = parser.parse_args()
    figures = {
        "tie": check.TIE,
        "comparisons": measure(arguments.decisions, arguments.seed),
    }
    record.store(arguments.out, figures, arguments.seed, ("onnx", "onnxruntime"))


if __name__ == "__main__":
    main()
