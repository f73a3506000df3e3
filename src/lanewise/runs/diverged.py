"""What is kept of a training whose numbers went wrong; `again` shows it.

``DIR/diverged/`` holds ``found.json``, what was not finite and where, and ``before``, the stage's
state before the chunk in which it happened. The run's checkpoints and metrics stay as the chunks
before it left them.
"""

import json
from dataclasses import asdict
from typing import Any

import jax

from lanewise.controllers.controller import Parameters
from lanewise.errors import NumbersError
from lanewise.runs import checkpoint, tree
from lanewise.runs.files import write_atomically
from lanewise.runs.folder import RunFolder
from lanewise.system.version import __version__
from lanewise.training import findings, stage
from lanewise.training.host import Ledger, StagePlan, StageProgress

FOLDER, BEFORE, FOUND = "diverged", "before", "found.json"
RATE = "a lower learner.learning_rate of {level} may help, in a new run"
OWN = "mend the function that {does}, then resuming goes on before it"
ADVICE = {
    "observation": OWN.format(does="observes or makes the start"),
    "reward": OWN.format(does="rewards"),
    "vehicles": OWN.format(does="makes the start"),
    "transitions": OWN.format(does="observes or rewards"),
    "loss": RATE,
    "weights": RATE,
    "validation": OWN.format(does="did it"),
}
"""By what was found first, what to do."""


def keep(
    folder: RunFolder,
    index: int,
    plan: StagePlan,
    frozen: Parameters,
    stored: StageProgress,
    reached: Ledger,
    error: NumbersError,
) -> NumbersError:
    """Keep what is needed to see a failure again.

    The chunk has consumed the state it began with. Chunks repeat to the bit, so it is driven to
    once more, from where the run would be resumed.

    Args:
        folder: the run.
        index: number of the stage.
        plan: the stage.
        frozen: parameters of levels that do not learn here.
        stored: the stage as its newest checkpoint holds it, or at its beginning; consumed.
        reached: the books before the chunk that failed.
        error: what was found in that chunk.

    Returns:
        The error that the user is to see.
    """
    state = stored.state
    for _ in range(reached.chunks - stored.ledger.chunks):
        state, _ = stage.advance(plan.course, frozen, state)
    meta = {"stage": index, "ledger": asdict(reached), "message": str(error)}
    with folder.held.inside(FOLDER) as place:
        checkpoint.save(place, BEFORE, tree.flatten({"state": state}), meta, folder.digest)
    _, metrics = stage.advance(plan.course, frozen, state)
    again = [asdict(one) for one in findings.of(jax.device_get(metrics.finite))]
    found, first = list(error.found), error.found[0]
    about: dict[str, Any] = {
        "message": str(error),
        "stage": plan.name,
        "chunk": reached.chunks + 1,
        "decisions_before": reached.decisions,
        "worlds": plan.course.budget.worlds,
        "found": found,
        # A validation is not driven again here; its message names the episode.
        "found_again": None if again == [] and first["what"] == "validation" else again == found,
        "controller": folder.controller,
        "seed": folder.seed,
        "settings_digest": folder.digest,
        "parts": list(folder.parts),
        "lanewise": __version__,
        "jax": jax.__version__,
    }
    with folder.held.inside(FOLDER) as place:
        write_atomically(place, {FOUND: (json.dumps(about, indent=1) + "\n").encode()})
    advice = ADVICE[first["what"]].format(level=first["level"])
    kept = folder.path / FOLDER
    return NumbersError(
        f"{error}; training stopped, earlier chunks are kept\n"
        f"  {advice}; lanewise.runs.again.see({str(folder.path)!r}) shows it ({kept})",
        error.found,
    )
