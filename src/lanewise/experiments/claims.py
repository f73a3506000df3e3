"""The paper's claims about its two controllers, each computed from what an experiment measured.

A claim is looked at once a seed, from the seed's training episodes, its tests and one recorded
drive. It *holds* if every seed says so, *fails* if none does, and otherwise *depends*.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lanewise.evaluation.episodes import Episodes, Recording
from lanewise.evaluation.metrics import TRAINING_WINDOW

RARELY = 0.02
"""At most this success rate counts as escaping no more."""
BRAKING = 5.0
"""The first timesteps, in which both slow down, s."""
LATER = 9.0
"""When the hierarchical controller is past the trap in the paper's film strip, s."""
MARGIN = 0.5
"""A gap must change by more than this to have grown or shrunk, m."""

Lines = Sequence[dict[str, Any]]


@dataclass(frozen=True)
class Evidence:
    """What one seed of one controller left behind."""

    training: Lines
    """Its training episodes, in their order: metrics lines of kind ``episode``."""
    settled: int
    """Episodes completed when epsilon had come down to its final value; all, if it never did."""
    test: Episodes
    recording: Recording


@dataclass(frozen=True)
class Seed:
    """One seed of an experiment, both controllers."""

    seed: int
    hierarchical: Evidence
    single_level: Evidence
    explorers: Sequence[Evidence] = ()
    """The single-level controller with more exploration, one for each schedule."""


@dataclass(frozen=True)
class Claim:
    """Something the paper says, and what an experiment says to it."""

    text: str
    seeds: tuple[bool, ...]
    """By seed: does it hold?"""
    figures: str
    """What the verdict rests on."""

    @property
    def verdict(self) -> str:
        """``holds``, ``fails`` or ``depends``."""
        if all(self.seeds):
            return "holds"
        return "depends" if any(self.seeds) else "fails"


def ledger(seeds: Sequence[Seed]) -> list[Claim]:
    """Every claim there is evidence for, over the given seeds; none without a seed."""
    if not seeds:
        return []
    explored = [seed for seed in seeds if seed.explorers]
    return [
        claim(explored if claim is _exploring_more else seeds)
        for claim in CLAIMS
        if explored or claim is not _exploring_more
    ]


def _early_escapes(seeds: Sequence[Seed]) -> Claim:
    pairs = [(_early(s.hierarchical), _early(s.single_level)) for s in seeds]
    return Claim(
        "While exploring, both controllers sometimes escape",
        tuple(ours > 0 and flat > 0 for ours, flat in pairs),
        f"success until epsilon settles: hierarchical {_percent([p[0] for p in pairs])}, "
        f"single-level {_percent([p[1] for p in pairs])}",
    )


def _flat_stops(seeds: Sequence[Seed]) -> Claim:
    early = [_early(s.single_level) for s in seeds]
    late = [_late(s.single_level, "success") for s in seeds]
    return Claim(
        "The flat controller stops escaping as its exploration falls",
        tuple(a > 0 and b <= RARELY for a, b in zip(early, late, strict=True)),
        f"single-level success until epsilon settles {_percent(early)}, "
        f"in the last {TRAINING_WINDOW} episodes {_percent(late)}",
    )


def _exploring_more(seeds: Sequence[Seed]) -> Claim:
    rates = [[float(e.test.success.mean()) for e in s.explorers] for s in seeds]
    flat = [float(s.single_level.test.success.mean()) for s in seeds]
    return Claim(
        "More initial exploration does not help the flat controller",
        tuple(max(more) <= base + RARELY for more, base in zip(rates, flat, strict=True)),
        f"success in tests: {_percent(flat)} without, "
        f"{_percent([max(r) for r in rates])} for the better of the schedules",
    )


def _keeps_improving(seeds: Sequence[Seed]) -> Claim:
    settled = [_around(s.hierarchical, "success") for s in seeds]
    late = [_late(s.hierarchical, "success") for s in seeds]
    return Claim(
        "The hierarchical controller keeps improving after epsilon has settled",
        tuple(b > a for a, b in zip(settled, late, strict=True)),
        f"success in {TRAINING_WINDOW} training episodes: {_percent(settled)} when epsilon "
        f"settled, {_percent(late)} at the end",
    )


def _varies_more(seeds: Sequence[Seed]) -> Claim:
    spreads = [
        [(_spread(s.hierarchical, name), _spread(s.single_level, name)) for name in MEASURES]
        for s in seeds
    ]
    means = np.mean(np.array(spreads), axis=0)
    figures = ", ".join(
        f"{name} {ours:.2g} against {flat:.2g}"
        for name, (ours, flat) in zip(MEASURES, means, strict=True)
    )
    return Claim(
        "The hierarchical controller varies more in every measure",
        tuple(all(ours > flat for ours, flat in pairs) for pairs in spreads),
        f"standard deviation over the last {TRAINING_WINDOW} training episodes, mean over seeds: "
        f"{figures}",
    )


def _brakes_harder(seeds: Sequence[Seed]) -> Claim:
    lowest = [
        tuple(
            float(e.recording.speed[e.recording.time <= BRAKING, 0].min())
            for e in (s.hierarchical, s.single_level)
        )
        for s in seeds
    ]
    return Claim(
        "The hierarchical controller brakes harder in the first 5 timesteps",
        tuple(ours < flat for ours, flat in lowest),
        "lowest speed: hierarchical "
        f"{_numbers([p[0] for p in lowest])}, single-level {_numbers([p[1] for p in lowest])} m/s",
    )


def _earns_more(seeds: Sequence[Seed]) -> Claim:
    found = []
    for s in seeds:
        ours, flat = (_at(e.recording, LATER) for e in (s.hierarchical, s.single_level))
        found.append((ours, flat))
    return Claim(
        "By t = 9 s the hierarchical controller earns more, instantly and in sum",
        tuple(all(a > b for a, b in zip(ours, flat, strict=True)) for ours, flat in found),
        "instant and accumulated reward, mean over seeds: hierarchical "
        f"{_numbers(np.mean([ours for ours, _ in found], axis=0))}, single-level "
        f"{_numbers(np.mean([flat for _, flat in found], axis=0))}",
    )


def _backs_off(seeds: Sequence[Seed]) -> Claim:
    gaps = [_gap(s.single_level.recording) for s in seeds]
    return Claim(
        "The flat controller backs off from the trap car, then closes the gap",
        tuple(g.max() > g[0] + MARGIN and g[-1] < g.max() - MARGIN for g in gaps),
        f"gap to the trap car ahead: {_numbers([g[0] for g in gaps])} m at the start, at most "
        f"{_numbers([g.max() for g in gaps])}, {_numbers([g[-1] for g in gaps])} at the end",
    )


def _more_accidents(seeds: Sequence[Seed]) -> Claim:
    rates = [
        tuple(float((e.test.accident != 0).mean()) for e in (s.hierarchical, s.single_level))
        for s in seeds
    ]
    return Claim(
        "The hierarchical controller has the higher accident rate",
        tuple(ours > flat for ours, flat in rates),
        f"in tests: hierarchical {_percent([r[0] for r in rates])}, single-level "
        f"{_percent([r[1] for r in rates])}",
    )


CLAIMS: tuple[Callable[[Sequence[Seed]], Claim], ...] = (
    _early_escapes,
    _flat_stops,
    _exploring_more,
    _keeps_improving,
    _varies_more,
    _brakes_harder,
    _earns_more,
    _backs_off,
    _more_accidents,
)
"""Every claim, in the order of the paper's text."""

MEASURES = ("success", "reward", "speed")
"""What the paper's training figure shows; reward is that of a decision, as lengths differ."""


def measure(line: dict[str, Any], name: str) -> float:
    """A measure of a training episode."""
    if name == "reward":
        return float(line["reward"]) / max(1, int(line["decisions"]))
    return float(line[name])


def _values(evidence: Evidence, name: str) -> NDArray[np.float64]:
    return np.array([measure(line, name) for line in evidence.training], np.float64)


def _mean(values: NDArray[np.float64]) -> float:
    return float(values.mean()) if len(values) else 0.0


def _early(evidence: Evidence) -> float:
    """Success rate until epsilon has settled."""
    return _mean(_values(evidence, "success")[: max(1, evidence.settled)])


def _around(evidence: Evidence, name: str) -> float:
    """Mean of the window that ends when epsilon has settled."""
    end = max(1, evidence.settled)
    return _mean(_values(evidence, name)[max(0, end - TRAINING_WINDOW) : end])


def _late(evidence: Evidence, name: str) -> float:
    return _mean(_values(evidence, name)[-TRAINING_WINDOW:])


def _spread(evidence: Evidence, name: str) -> float:
    last = _values(evidence, name)[-TRAINING_WINDOW:]
    return float(last.std()) if len(last) else 0.0


def _at(recording: Recording, time: float) -> tuple[float, float]:
    """(instant, accumulated) reward at a time, or at the end of a shorter drive."""
    frame = int(np.flatnonzero(recording.time <= time)[-1])
    return float(recording.reward[frame]), float(recording.accumulated_reward[frame])


def _gap(recording: Recording) -> NDArray[np.float64]:
    """From the ego to the trap car ahead of it at the start, m."""
    gap: NDArray[np.float64] = recording.x[:, 1] - recording.x[:, 0]
    return gap


def _percent(shares: Sequence[float]) -> str:
    return f"{100 * np.mean(shares):.1f} % ({100 * min(shares):.1f} to {100 * max(shares):.1f})"


def _numbers(values: Any) -> str:
    return ", ".join(f"{value:.2f}" for value in values)
