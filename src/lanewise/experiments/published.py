"""Whether a test or a training is the paper's, so that its figures may stand beside. No JAX."""

from collections.abc import Callable, Iterable

from lanewise import config
from lanewise.config.settings import TRAPS, Settings
from lanewise.fields.ranges import show

TRAINING_STARTS = "scenario.training_"
"""Begins the scenario settings that tests do not use."""
CONTROLLERS_OWN = ("driving.observation.", "driving.actions.")
"""What a controller observes and can do: part of it, not of the test."""
NOISE = "driving.observation.noise"
"""Of the test though: it is the world's doing."""
DURATION = "evaluation.duration"
TRAP = "trap-10"
"""The scenario of the published tests; the published training speed fits either (row 5)."""


def belongs_to_test(name: str) -> bool:
    """Whether a setting says how a test starts, how traffic drives or how it is judged."""
    return (_of_the_task(name) and not name.startswith(TRAINING_STARTS)) or name == DURATION


def unlike_test(settings: Settings, task: Iterable[str] = (), split: str = "test") -> str:
    """What makes a test another than the published ones; empty where nothing does.

    ``task`` holds the names of the user's own functions, ``split`` is that of its starts.
    """
    if own := next(iter(task), ""):
        return own
    if split != "test":
        return f"its starts are those of {split}"
    return _difference(settings, belongs_to_test, (TRAP,))


def unlike_training(settings: Settings) -> str:
    """What makes a training another than the published ones; empty where nothing does.

    How much and how it learns is not looked at, nor how long its episodes are.
    """
    return _difference(settings, _of_the_task, TRAPS)


def _of_the_task(name: str) -> bool:
    if name == NOISE:
        return True
    return name.startswith(("scenario.", "driving.")) and not name.startswith(CONTROLLERS_OWN)


def _difference(settings: Settings, counts: Callable[[str], bool], traps: Iterable[str]) -> str:
    """The settings that count and are not as under any of the scenario presets."""
    found = []
    for trap in traps:
        differing = config.differences([settings, config.compose(trap=trap)]).items()
        found.append([f"{n} is {show(a)}, not {show(b)}" for n, (a, b) in differing if counts(n)])
    return ", ".join(found[0]) if all(found) else ""
