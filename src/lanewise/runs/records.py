"""Records of a run's metrics file, each known to be one before anything is made of it."""

from pathlib import Path
from typing import Any

from lanewise.errors import RunError, brief
from lanewise.runs import metrics

LEVEL = ("updates", "transitions", "epsilon", "loss", "mean_q")
FRESH = ("escape_rate", "success_rate", "accident_rate", "reward", "speed")
"""Figures of weights on validation starts by which none were chosen."""
COLUMNS = {
    "episode": (
        *("stage", "episode", "decision", "escaped", "success", "accident"),
        *("decisions", "reward", "timestep_reward", "speed"),
    ),
    "chunk": (
        *("stage", "chunk", "decisions", "episodes", *LEVEL),
        *("escape_rate", "success_rate", "accident_rate", "reward", "timestep_reward", "speed"),
        *("validation_escape_rate", "validation_success_rate", "validation_accident_rate"),
        *("validation_reward", "best_chunk", *(f"high_level_{name}" for name in LEVEL)),
    ),
    "weights": (
        *("stage", "rule", "kept_chunk", "last_chunk", "fresh_episodes"),
        *(f"{of}_{name}" for of in ("kept", "last") for name in FRESH),
    ),
}
"""Fields by kind of record, besides the kind itself."""
OPTIONAL = ("validation_", "best_chunk", "high_level_", "escape")
"""Begins what not every record has; older ones lack the paper's success."""
_TEXTS = ("kind", "stage", "accident", "rule")
_COUNTS = (
    *("episode", "decision", "decisions", "chunk", "episodes", "updates", "transitions"),
    *("kept_chunk", "last_chunk", "fresh_episodes"),
)
_LARGEST_COUNT = 2**63


def read(path: Path, end: int | None = None, sha256: str | None = None) -> list[dict[str, Any]]:
    """The records of a metrics file; a last line cut short by a kill is left out.

    Args:
        path: the file.
        end: read no further than so many bytes; None reads all.
        sha256: of these bytes, where it was remembered.

    Raises:
        RunError: the file cannot be read or was altered, or a line is no record.
    """
    found = metrics.read(path, end, sha256)
    for number, record in enumerate(found, 1):
        if problem := _problem(record):
            raise RunError(f"{path} is damaged: line {number} {problem}")
    return found


def _problem(record: dict[str, Any]) -> str:
    """What is wrong with a record; empty where nothing is."""
    kind = record.get("kind")
    if kind not in COLUMNS:
        return f"has a kind other than {', '.join(COLUMNS)}"
    for name in COLUMNS[kind]:
        if name not in record and not name.startswith(OPTIONAL):
            return f"lacks {name}"
    for name, value in record.items():
        if name != "kind" and name not in COLUMNS[kind]:
            return f'has a field "{brief(name)}", which does not belong there'
        if not _fits(name, value) or (value is None and kind == "episode"):
            return f"holds no {name}"
    return ""


def _fits(name: str, value: Any) -> bool:
    if name in _TEXTS:
        return isinstance(value, str)
    if name in _COUNTS:
        return type(value) is int and 0 <= value < _LARGEST_COUNT
    return value is None or isinstance(value, int | float)
