"""The records of a training's metrics: of its episodes, its chunks, and the weights it hands on."""

from typing import Any

import numpy as np

from lanewise.driving.episode import EpisodeStats
from lanewise.evaluation.episodes import ACCIDENTS, Episodes
from lanewise.training.selection import StageCounters
from lanewise.training.stage import LevelMetrics


def of_episodes(stage: str, counters: StageCounters, stats: EpisodeStats) -> list[dict[str, Any]]:
    """A record for each episode completed in a chunk, ordered by (decision, world).

    ``counters`` are those before the chunk; ``stats`` are [iterations, worlds].
    """
    worlds = stats.outcome.over.shape[1]
    return [
        {
            "kind": "episode",
            "stage": stage,
            "episode": counters.episodes + number,
            "decision": counters.decisions + at[0] * worlds + at[1] + 1,
            "escaped": bool(stats.escaped[at]),
            "success": bool(stats.success[at]),
            "accident": ACCIDENTS[int(stats.outcome.accident[at])],
            "decisions": int(stats.decisions[at]),
            "reward": float(stats.reward[at]),
            "timestep_reward": float(stats.timestep_reward[at]),
            "speed": float(stats.speed_sum[at] / np.float32(stats.decisions[at])),
        }
        for number, at in enumerate(map(tuple, np.argwhere(stats.outcome.over).tolist()), 1)
    ]


def of_chunk(
    stage: str,
    counters: StageCounters,
    levels: dict[str, LevelMetrics],
    episodes: list[dict[str, Any]],
    validation: Episodes | None,
) -> dict[str, Any]:
    """The record of a chunk; means are None where there was nothing to average.

    ``counters`` are those after the chunk; ``levels`` those that learn, in the order in which they
    choose; ``episodes`` the records of those completed in it.
    """

    def mean(values: list[Any]) -> float | None:
        return float(np.mean(values)) if values else None

    record: dict[str, Any] = {
        "kind": "chunk",
        "stage": stage,
        "chunk": counters.chunks,
        "decisions": counters.decisions,
        "episodes": counters.episodes,
    }
    *_, last = levels
    for name, metrics in levels.items():
        record |= _of_level("" if name == last else f"{name}_", metrics)
    record |= {
        "escape_rate": mean([each["escaped"] for each in episodes]),
        "success_rate": mean([each["success"] for each in episodes]),
        "accident_rate": mean([each["accident"] != "none" for each in episodes]),
        "reward": mean([each["reward"] for each in episodes]),
        "timestep_reward": mean([each["timestep_reward"] for each in episodes]),
        "speed": mean([each["speed"] for each in episodes]),
    }
    if validation is not None:
        record |= of_tested("validation", validation) | {"best_chunk": counters.best_chunk}
    return record


def of_tested(prefix: str, found: Episodes) -> dict[str, float]:
    """Figures of greedy episodes on validation starts, with a prefix before their names."""
    return {
        f"{prefix}_escape_rate": float(np.mean(found.escaped)),
        f"{prefix}_success_rate": float(np.mean(found.success)),
        f"{prefix}_accident_rate": float(np.mean(found.accident > 0)),
        f"{prefix}_reward": float(np.mean(found.accumulated_reward)),
    }


def _of_level(prefix: str, level: LevelMetrics) -> dict[str, Any]:
    def finite(value: Any) -> float | None:
        return float(value) if np.isfinite(value) else None

    return {
        f"{prefix}updates": int(level.updates),
        f"{prefix}transitions": int(level.transitions),
        f"{prefix}epsilon": float(level.epsilon),
        f"{prefix}loss": finite(level.loss),
        f"{prefix}mean_q": finite(level.mean_q),
    }
