"""Trainings that take a second once compiled, for whoever trains again and again."""

import jax

from lanewise import config
from lanewise.config.settings import ONE_LEVEL_STAGES
from lanewise.controllers.registry import CONTROLLERS
from lanewise.runs import run_state, training_loop
from lanewise.runs.run_folder import RunFolder
from lanewise.system.progress import Progress
from lanewise.training.plan import TrainingPlan

LEVEL = {
    "learner.hidden": (16, 16),
    "learner.batch_size": 8,
    "learner.warm_up": 40,
    "learner.replay_capacity": 300,
}
BUDGET = {"worlds": 2, "duration": 12}
CHUNK = 100
"""Decisions in a chunk: 50 in each world."""
STAGES_OF = {
    name: [stage.name for stage in CONTROLLERS[name].stages]
    for name in ("single-level", "planned", "hierarchical", "h-dqn")
}
"""Names of the stages of a training, by controller."""


def flags(chunks: int, epsilon_chunks: int | None = None) -> dict[str, object]:
    """Settings of a training of so many chunks a stage; epsilon falls over ``epsilon_chunks``."""
    level = dict(LEVEL)
    if epsilon_chunks is not None:
        level["exploration.steps"] = epsilon_chunks * CHUNK
    budget = BUDGET | {"decisions": chunks * CHUNK}
    found: dict[str, object] = {
        "scenario.traffic.vehicles_ahead": 0,
        "planner.preview": 2,
        "evaluation.duration": 4,
        "evaluation.validation_episodes": 5,
        "evaluation.validation_interval": 2,
        "evaluation.fresh_episodes": 5,
    }
    for part, values in (
        *((stage, budget | level) for stage in ONE_LEVEL_STAGES),
        *(("h_dqn", budget), ("h_dqn.high_level", level), ("h_dqn.low_level", level)),
    ):
        found |= {f"{part}.{name}": value for name, value in values.items()}
    return found


class Quiet(Progress):
    """A reporter that says nothing, remembers notes, and can break in.

    ``at`` is (stage, chunks since the stage was begun or continued); 0 before the first.
    """

    def __init__(self, at=None, action=lambda: None):
        self.at, self.action, self.notes, self.updates, self.name = at, action, [], 0, ""

    def stage(self, name, total, done=0.0):
        self.name, self.updates = name, 0
        self._break_in()

    def update(self, done, **metrics):
        self.updates += 1
        self._break_in()

    def note(self, text):
        self.notes.append(text)

    def _break_in(self):
        if (self.name, self.updates) == self.at:
            self.action()


def create(path, values, controller, seed):
    """A new run folder, locked."""
    return RunFolder.create(path, config.compose(flags=values), controller, seed)


def train(folder, reporter=None, high_level=None):
    """Train in a run folder to the end."""
    plan = TrainingPlan.build(folder.settings, folder.controller)
    training_loop.train(folder, plan, reporter or Quiet(), high_level=high_level)


def finish(path, settings, controller, seed, weights):
    """A finished run without a training; ``weights`` makes those of a shape."""
    with RunFolder.create(path, settings, controller, seed) as folder:
        shapes = TrainingPlan.build(settings, controller).parameters
        made = jax.tree.map(lambda leaf: weights(leaf.shape).astype(leaf.dtype), shapes)
        run_state.save_controller(folder, made)


def stop(*_, **__):
    """Stands in for what Ctrl-C interrupts."""
    raise KeyboardInterrupt


def moved(path):
    """Somebody gives a folder another name."""
    path.rename(path.with_name("elsewhere"))


def resume(path, reporter=None):
    """Continue a run."""
    with RunFolder.resume(path) as folder:
        train(folder, reporter)


def results(path, names=("controller.safetensors", "metrics.jsonl", "episodes.csv", "chunks.csv")):
    """The bytes of what a training leaves that must never differ."""
    return {name: (path / name).read_bytes() for name in names}


def everything(path):
    """The bytes of every file below a folder, and None for the folders, by path."""
    return {each: each.read_bytes() if each.is_file() else None for each in sorted(path.rglob("*"))}
