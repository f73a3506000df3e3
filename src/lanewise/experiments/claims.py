"""The paper's claims about its controllers, each computed from what an experiment measured.

A claim is looked at once a seed, from the seed's training episodes, its tests and one recorded
drive. It *holds* if every seed says so, *fails* if none does, and otherwise *depends*. Words in
quotation marks are the paper's.

Success is the paper's here: the ego's rear bumper passes the front of all trap cars before the
episode ends, whether or not an accident follows.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lanewise.evaluation.episodes import Episodes, Recording
from lanewise.evaluation.metrics import TRAINING_WINDOW

RARELY = 0.02
"""At most this success rate is minimal, and a gain of at most this no significant enhancement."""
MOSTLY = 0.9
"""Above this success rate a controller escapes."""
EXPLORING = 100
"""At least so many first episodes are the initial exploration phase: with one world epsilon settles
within the first few of the paper's 2000."""
STEADY = 0.1
"""Nearly constant: a standard deviation of at most this share of the mean."""
TARGET_SPEED, NEAR = 15.0, 1.0
"""The paper's target speed, and how far from it is close to it, m/s."""
ENDING = 5.0
"""The end of a drive, over which its speed is averaged, s."""
MORE_SUCCESS, MORE_REWARD = 0.1, 1.0
"""Better in tests: by more than this; a tenth of what separates the paper's two controllers."""
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
    recording: Recording | None = None
    """One drive from the test start; of the two compared controllers alone."""

    @property
    def drive(self) -> Recording:
        """The drive, where there is one."""
        assert self.recording is not None, "only the two compared controllers are driven"
        return self.recording


@dataclass(frozen=True)
class Seed:
    """One seed of an experiment: both controllers, and the other arms there are."""

    seed: int
    hierarchical: Evidence
    single_level: Evidence
    explorers: Sequence[Evidence] = ()
    """The single-level controller with more exploration, one for each schedule."""
    h_dqn: Evidence | None = None
    """Both levels at once, the low level rewarded for its goals alone."""
    one_step: Evidence | None = None
    """Both levels at once, the low level rewarded as in step 2."""


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
    """Every claim there is evidence for, each over the seeds that have it; none without a seed."""
    found = []
    for claim in CLAIMS:
        needed = _NEEDS.get(claim)
        asked = [seed for seed in seeds if needed is None or getattr(seed, needed)]
        if asked:
            found.append(claim(asked))
    return found


def _early_escapes(seeds: Sequence[Seed]) -> Claim:
    pairs = [(_early(s.hierarchical), _early(s.single_level)) for s in seeds]
    return Claim(
        'While exploring, both controllers "exhibited tendencies to escape"',
        tuple(ours > 0 and flat > 0 for ours, flat in pairs),
        f"success until epsilon settles, in the first {EXPLORING} episodes at least: "
        f"{_both(pairs)}",
    )


def _flat_stops(seeds: Sequence[Seed]) -> Claim:
    early = [_early(s.single_level) for s in seeds]
    late = [_late(s.single_level, "success") for s in seeds]
    return Claim(
        'As its exploration falls, the flat controller shows "a minimal probability of escaping"',
        tuple(rate <= RARELY for rate in late),
        f"single-level success in the last {TRAINING_WINDOW} training episodes {_percent(late)}, "
        f"while exploring {_percent(early)}; {100 * RARELY:.0f} % at most is minimal",
    )


def _above_h_dqn(seeds: Sequence[Seed]) -> Claim:
    found = [
        [(_late(s.hierarchical, name), _late(s.h_dqn, name)) for name in MEASURES]
        for s in seeds
        if s.h_dqn is not None
    ]
    return Claim(
        'The hierarchical controller has a "higher likelihood" of escaping, "higher average '
        'rewards" and a "higher average speed" than h-DQN in training',
        tuple(all(ours > other for ours, other in pairs) for pairs in found),
        f"means of the last {TRAINING_WINDOW} training episodes, mean over seeds, reward a "
        f"decision: {_against(found)}",
    )


def _flat_is_steady(seeds: Sequence[Seed]) -> Claim:
    spreads = [
        [_relative_spread(s.single_level, name) for name in ("speed", "reward")] for s in seeds
    ]
    return Claim(
        'The flat controller has "nearly constant average speed and reward in each episode"',
        tuple(max(pair) <= STEADY for pair in spreads),
        f"standard deviation over mean of the last {TRAINING_WINDOW} training episodes, nearly "
        f"constant up to {100 * STEADY:.0f} %: speed {_percent([pair[0] for pair in spreads])}, "
        f"reward a decision {_percent([pair[1] for pair in spreads])}",
    )


def _near_target(seeds: Sequence[Seed]) -> Claim:
    drives = [s.hierarchical.drive for s in seeds]
    speeds = [_last_speed(drive) for drive in drives]
    escaped = [bool(drive.escaped[-1]) for drive in drives]
    return Claim(
        'The hierarchical controller comes to "closely approach the target speed of 15m/s after '
        'overtaking"',
        tuple(
            out and abs(speed - TARGET_SPEED) <= NEAR
            for out, speed in zip(escaped, speeds, strict=True)
        ),
        f"mean speed in the last {ENDING:.0f} s of a drive: {_numbers(speeds)} m/s, "
        f"{sum(escaped)} of {len(drives)} drives past the trap; within {NEAR:.0f} m/s is close",
    )


def _varies_more(seeds: Sequence[Seed]) -> Claim:
    spreads = [
        [(_spread(s.hierarchical, name), _spread(s.single_level, name)) for name in MEASURES]
        for s in seeds
    ]
    return Claim(
        'The hierarchical controller shows "greater variance in all of the evaluation criteria"',
        tuple(all(ours > flat for ours, flat in pairs) for pairs in spreads),
        f"standard deviation over the last {TRAINING_WINDOW} training episodes, mean over seeds: "
        f"{_against(spreads)}",
    )


def _exploring_more(seeds: Sequence[Seed]) -> Claim:
    rates = [max(_late(more, "success") for more in s.explorers) for s in seeds]
    flat = [_late(s.single_level, "success") for s in seeds]
    tested = [max(_test_rate(more) for more in s.explorers) for s in seeds]
    return Claim(
        'More initial exploration brings the flat controller "no significant enhancement"',
        tuple(more <= base + RARELY for more, base in zip(rates, flat, strict=True)),
        f"success in the last {TRAINING_WINDOW} training episodes: {_percent(flat)} without, "
        f"{_percent(rates)} for the better of the schedules; up to {100 * RARELY:.0f} points more "
        f"are no enhancement. In tests, with the weights kept: {_percent(tested)}",
    )


def _keeps_improving(seeds: Sequence[Seed]) -> Claim:
    settled = [_around(s.hierarchical, "success") for s in seeds]
    late = [_late(s.hierarchical, "success") for s in seeds]
    return Claim(
        'The hierarchical controller "continued to show enhancements even when the exploration '
        'value stabilized"',
        tuple(b > a for a, b in zip(settled, late, strict=True)),
        f"success in {TRAINING_WINDOW} training episodes: {_percent(settled)} when exploration "
        f"had ended, {_percent(late)} at the end",
    )


def _earns_more(seeds: Sequence[Seed]) -> Claim:
    found = []
    for s in seeds:
        ours, flat = (_at(e.drive, LATER) for e in (s.hierarchical, s.single_level))
        found.append((ours, flat))
    return Claim(
        'By t = 9 s the hierarchical controller has "higher immediate and accumulated rewards"',
        tuple(all(a > b for a, b in zip(ours, flat, strict=True)) for ours, flat in found),
        "instant and accumulated reward, mean over seeds: hierarchical "
        f"{_numbers(np.mean([ours for ours, _ in found], axis=0))}, single-level "
        f"{_numbers(np.mean([flat for _, flat in found], axis=0))}",
    )


def _slows_more(seeds: Sequence[Seed]) -> Claim:
    lowest = [
        tuple(
            float(e.drive.speed[e.drive.time <= BRAKING, 0].min())
            for e in (s.hierarchical, s.single_level)
        )
        for s in seeds
    ]
    return Claim(
        "In the first 5 timesteps the speed reduction of the hierarchical controller is "
        '"more substantial"',
        tuple(ours < flat for ours, flat in lowest),
        "lowest speed: hierarchical "
        f"{_numbers([p[0] for p in lowest])}, single-level {_numbers([p[1] for p in lowest])} m/s",
    )


def _backs_off(seeds: Sequence[Seed]) -> Claim:
    """Both start at one speed, so whoever slows down falls back."""
    gaps = [_gap(s.single_level.drive) for s in seeds]
    return Claim(
        'The flat controller slows down "to maintain a safe following distance", then speeds up '
        '"to minimize the gap"',
        tuple(g.max() > g[0] + MARGIN and g[-1] < g.max() - MARGIN for g in gaps),
        f"gap to the trap car ahead: {_numbers([g[0] for g in gaps])} m at the start, at most "
        f"{_numbers([g.max() for g in gaps])}, {_numbers([g[-1] for g in gaps])} at the end",
    )


def _escapes(seeds: Sequence[Seed]) -> Claim:
    rates = [(_test_rate(s.hierarchical), _test_rate(s.single_level)) for s in seeds]
    return Claim(
        "In tests the hierarchical controller escapes (97.67 %) and the flat one does not (0 %)",
        tuple(ours > MOSTLY and flat <= RARELY for ours, flat in rates),
        _both(rates),
    )


def _more_accidents(seeds: Sequence[Seed]) -> Claim:
    rates = [
        tuple(float((e.test.accident != 0).mean()) for e in (s.hierarchical, s.single_level))
        for s in seeds
    ]
    return Claim(
        'The flat controller has "better performance in terms of the accident rate"',
        tuple(ours > flat for ours, flat in rates),
        f"in tests: {_both(rates)}",
    )


def _two_steps(seeds: Sequence[Seed]) -> Claim:
    pairs = [
        ((_test_rate(two), _test_reward(two)), (_test_rate(one), _test_reward(one)))
        for two, one in ((s.hierarchical, s.one_step) for s in seeds)
        if one is not None
    ]
    (success, reward), (success_of_one, reward_of_one) = (
        zip(*arm, strict=True) for arm in zip(*pairs, strict=True)
    )
    return Claim(
        'Two steps are needed "to enhance the controller\'s effectiveness"',
        tuple(_better(two, one) for two, one in pairs),
        f"in tests, two steps against one: success {_percent(success)} against "
        f"{_percent(success_of_one)}, reward {np.mean(reward):.2f} against "
        f"{np.mean(reward_of_one):.2f}; better is by more than {100 * MORE_SUCCESS:.0f} points or "
        f"{MORE_REWARD:.1f}, and in neither worse by as much",
    )


Make = Callable[[Sequence[Seed]], Claim]

CLAIMS: tuple[Make, ...] = (
    _early_escapes,
    _flat_stops,
    _above_h_dqn,
    _flat_is_steady,
    _near_target,
    _varies_more,
    _exploring_more,
    _keeps_improving,
    _earns_more,
    _slows_more,
    _backs_off,
    _escapes,
    _more_accidents,
    _two_steps,
)
"""Every claim, in the order of the paper's experiments; its second contribution last."""

_NEEDS: Mapping[Make, str] = {
    _above_h_dqn: "h_dqn",
    _exploring_more: "explorers",
    _two_steps: "one_step",
}
"""The field of a seed without which a claim has no evidence."""

MEASURES = ("success", "reward", "speed")
"""What the paper's training figure shows; reward is that of a decision, as lengths differ."""


def measure(line: dict[str, Any], name: str) -> float:
    """A measure of a training episode; success is the paper's."""
    if name == "reward":
        return float(line["reward"]) / max(1, int(line["decisions"]))
    if name == "success":
        return float(line["escaped"])
    return float(line[name])


def _test_rate(evidence: Evidence) -> float:
    return float(evidence.test.escaped.mean())


def _test_reward(evidence: Evidence) -> float:
    return float(evidence.test.accumulated_reward.mean())


def _better(one: tuple[float, float], other: tuple[float, float]) -> bool:
    """Is one (success, reward) better than another by more than the margins, and never worse?"""
    success = (one[0] - other[0]) / MORE_SUCCESS
    reward = (one[1] - other[1]) / MORE_REWARD
    return max(success, reward) > 1 and min(success, reward) >= -1


def _values(evidence: Evidence, name: str) -> NDArray[np.float64]:
    return np.array([measure(line, name) for line in evidence.training], np.float64)


def _mean(values: NDArray[np.float64]) -> float:
    return float(values.mean()) if len(values) else 0.0


def _explored(evidence: Evidence) -> int:
    """Episodes of the initial exploration phase."""
    return max(EXPLORING, evidence.settled)


def _early(evidence: Evidence) -> float:
    """Success rate in the initial exploration phase."""
    return _mean(_values(evidence, "success")[: _explored(evidence)])


def _around(evidence: Evidence, name: str) -> float:
    """Mean of the window that ends with the initial exploration phase."""
    end = _explored(evidence)
    return _mean(_values(evidence, name)[max(0, end - TRAINING_WINDOW) : end])


def _late(evidence: Evidence, name: str) -> float:
    return _mean(_values(evidence, name)[-TRAINING_WINDOW:])


def _spread(evidence: Evidence, name: str) -> float:
    last = _values(evidence, name)[-TRAINING_WINDOW:]
    return float(last.std()) if len(last) else 0.0


def _relative_spread(evidence: Evidence, name: str) -> float:
    """Standard deviation over mean; infinite around 0."""
    mean = abs(_late(evidence, name))
    return _spread(evidence, name) / mean if mean else inf


def _last_speed(recording: Recording) -> float:
    """The ego's mean speed at the end of a drive, m/s."""
    last = recording.time > recording.time[-1] - ENDING
    return float(recording.speed[last, 0].mean())


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


def _both(rates: Sequence[tuple[float, ...]]) -> str:
    """Rates of the hierarchical and the single-level controller, by seed."""
    ours, flat = zip(*rates, strict=True)
    return f"hierarchical {_percent(ours)}, single-level {_percent(flat)}"


def _against(seeds: Sequence[Sequence[tuple[float, float]]]) -> str:
    """Pairs of each measure, by seed."""
    return ", ".join(
        f"{name} {ours:.2g} against {other:.2g}"
        for name, (ours, other) in zip(MEASURES, np.mean(np.array(seeds), axis=0), strict=True)
    )


def _numbers(values: Any) -> str:
    return ", ".join(f"{value:.2f}" for value in values)
