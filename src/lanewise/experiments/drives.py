"""Recorded test episodes of each arm's median seed, small enough to be kept with a report.

A file an arm, ``drives/ARM.npz``, read with `read`; positions in whole centimetres. ``report.json``
says which seed it is (``median_seed``); the seed's weights are in ``runs/ARM/seed-N``.
"""

from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from statistics import median_low
from typing import Any

import numpy as np

from lanewise.evaluation.episodes import Recording
from lanewise.evaluation.settings import WORLDS
from lanewise.experiments.results import ArmResult, SeedResult

FOLDER = "drives"
"""Below the report."""
EPISODES = 5
"""Of each arm, the first ones of its tests."""
PER_METRE = 100
_PLACES = ("x", "y")


def median_seed(seeds: Sequence[SeedResult]) -> SeedResult:
    """The seed in the middle by its tests in our world, of two the lower one.

    By our success, then by reward.
    """

    def rank(place: int) -> tuple[float, float, int]:
        values = seeds[place].tests[WORLDS[0]].summary.values
        return values["success_rate"], values["accumulated_reward"], place

    return seeds[median_low(map(rank, range(len(seeds))))[-1]]


def write(out: Path, results: Sequence[ArmResult]) -> None:
    """Drive and keep the episodes of every arm below ``out``."""
    (out / FOLDER).mkdir()
    for result in results:
        seed = median_seed(result.seeds)
        save(out / FOLDER / f"{result.arm.name}.npz", [seed.record(i) for i in range(EPISODES)])


def save(path: Path, recordings: Sequence[Recording]) -> None:
    """Keep recordings in a file."""
    arrays = {
        f"{number}/{field.name}": _small(field.name, getattr(recording, field.name))
        for number, recording in enumerate(recordings)
        for field in fields(Recording)
    }
    np.savez_compressed(path, **arrays)  # type: ignore[arg-type]


def read(path: Path) -> list[Recording]:
    """The recordings of a file, numbers as exact as they were kept."""
    with np.load(path, allow_pickle=False) as found:  # noqa: TID251, arrays alone
        count = 1 + max(int(name.partition("/")[0]) for name in found.files)
        names = [field.name for field in fields(Recording)]
        return [
            Recording(
                **{
                    name: _whole(name, found[f"{number}/{name}"])
                    for name in names
                    if f"{number}/{name}" in found
                }
            )
            for number in range(count)
        ]


def _small(name: str, value: object) -> np.ndarray:
    array = np.asarray(value)
    if name in _PLACES:
        return np.round(array * PER_METRE).astype(np.int32)
    return array.astype(np.float32) if array.dtype == np.float64 else array


def _whole(name: str, array: np.ndarray) -> Any:
    if name in _PLACES:
        return array / PER_METRE
    if array.ndim == 0:
        return array.item()
    return array.astype(np.float64) if array.dtype == np.float32 else array
