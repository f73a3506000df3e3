"""One update of double Q-learning: updates a second, and how near the matrix product's own rate."""

from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

from lanewise.bench import processes
from lanewise.bench.task import Asked, Figure, Task
from lanewise.learning.settings import LearnerSettings

PART = "update"
UNIT, PRODUCT_UNIT = "updates/s", "GFLOP/s"
INPUTS, OUTPUTS = 26, 9
"""Of the networks: `driving.observation.SIZE` and `driving.actions.COUNT`."""


def tasks(asked: Asked) -> list[Task]:
    """Ours and PyTorch's, on one core and on all, each beside the matrix product's rate."""
    learner = LearnerSettings()
    seconds = {"seconds": asked.seconds}
    product = seconds | {
        "rows": learner.batch_size,
        "inner": learner.hidden[0],
        "columns": learner.hidden[1],
    }
    shape = seconds | {"inputs": INPUTS, "outputs": OUTPUTS}
    same = shape | {
        "hidden": learner.hidden,
        "batch": learner.batch_size,
        "capacity": learner.replay_capacity,
        "learning_rate": learner.learning_rate,
        "discount": learner.discount,
    }
    measured: list[tuple[str, str, dict[str, Any], Path | None]] = [
        ("matrix product, XLA", "lanewise_product", product, None),
        ("lanewise", "lanewise_update", shape, None),
    ]
    if torch := asked.interpreters.find("PyTorch"):
        ours_too = same | {"target_rate": learner.target_rate}
        measured += [
            ("matrix product, PyTorch", "torch_product", product, torch),
            ("PyTorch, double DQN", "torch_update", ours_too, torch),
            (
                "PyTorch, double DQN, torch.compile",
                "torch_update",
                ours_too | {"compiled": True},
                torch,
            ),
        ]
    if sb3 := asked.interpreters.find("Stable-Baselines3"):
        measured.append(("Stable-Baselines3, DQN", "sb3_update", same, sb3))
    return [
        Task(
            f"update: {case}: {subject}",
            partial(_measure, case, subject, cores, worker, arguments, python),
        )
        for cores in sorted({1, asked.cores})
        for case in [f"batch {learner.batch_size}, {cores} core{'s' if cores > 1 else ''}"]
        for subject, worker, arguments, python in measured
    ]


def flops(inputs: int, hidden: tuple[int, ...], outputs: int, batch: int) -> float:
    """Floating-point operations of an update's matrix products.

    Three forward passes, and backward one product for each weight matrix and one for each layer's
    input except the first's, each of 2 operations a weight and transition.
    """
    widths = (inputs, *hidden, outputs)
    weights = [wide * narrow for wide, narrow in pairwise(widths)]
    return 2.0 * batch * (4 * sum(weights) + sum(weights[1:]))


def _measure(
    case: str, subject: str, cores: int, worker: str, arguments: dict[str, Any], python: Path | None
) -> list[Figure]:
    result = processes.alone(worker, arguments, cores, python)
    detail = {name: result[name] for name in result if name in ("compile_seconds",)}
    detail["peak_memory_bytes"] = result["peak_memory_bytes"]
    if "flops" in result:
        rate = result["flops"] / result["seconds"] / 1e9
        return [Figure(PART, case, subject, rate, PRODUCT_UNIT, detail)]
    rate = result["updates"] / result["seconds"]
    learner = LearnerSettings()
    work = flops(INPUTS, learner.hidden, OUTPUTS, learner.batch_size)
    if subject != "Stable-Baselines3, DQN":
        detail["gflop_per_second"] = rate * work / 1e9
    return [Figure(PART, case, subject, rate, UNIT, detail)]
