"""The parts that can be measured, by the name people type."""

from collections.abc import Callable

from lanewise.bench.parts import (
    evaluation,
    gpu,
    latency,
    level,
    scaling,
    start_up,
    training,
    update,
    world,
)
from lanewise.bench.task import Asked, Task

PARTS: dict[str, Callable[[Asked], list[Task]]] = {
    part.PART: part.tasks
    for part in (start_up, world, latency, update, training, evaluation, scaling, level, gpu)
}
"""In the order in which they are measured."""
