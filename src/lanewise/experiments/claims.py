"""The paper's claims about its controllers, each computed from what an experiment measured.

A claim is looked at once a seed, from the seed's training episodes, its tests and one recorded
drive. It *holds* if every seed says so, *fails* if none does, and otherwise *depends*. Words in
quotation marks are the paper's.

Success is the paper's here: the ego's rear bumper passes the front of all trap cars before the
episode ends, whether or not an accident follows.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from lanewise.evaluation.metrics import TRAINING_WINDOW
from lanewise.experiments.evidence import ENDING, EXPLORING, MEASURES, Evidence

RARELY = 0.02
"""At most this success rate is minimal, and a gain of at most this no significant enhancement."""
MOSTLY = 0.9
"""Above this success rate a controller escapes."""
STEADY = 0.1
"""Nearly constant: a standard deviation of at most this share of the mean."""
TARGET_SPEED, NEAR = 15.0, 1.0
"""The paper's target speed, and how far from it is close to it, m/s."""
MORE_SUCCESS, MORE_REWARD = 0.1, 1.0
"""Better in tests: by more than this; a tenth of what separates the paper's two controllers."""
LATER = 9.0
"""When the hierarchical controller is past the trap in the paper's film strip, s."""
MARGIN = 0.5
"""A gap must change by more than this to have grown or shrunk, m."""


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
    pairs = [(s.hierarchical.early_success, s.single_level.early_success) for s in seeds]
    return Claim(
        'While exploring, both controllers "exhibited tendencies to escape"',
        tuple(ours > 0 and flat > 0 for ours, flat in pairs),
        f"success until epsilon settles, in the first {EXPLORING} episodes at least: "
        f"{_both(pairs)}",
    )


def _flat_stops(seeds: Sequence[Seed]) -> Claim:
    early = [s.single_level.early_success for s in seeds]
    late = [s.single_level.late("success") for s in seeds]
    return Claim(
        'As its exploration falls, the flat controller shows "a minimal probability of escaping"',
        tuple(rate <= RARELY for rate in late),
        f"single-level success in the last {TRAINING_WINDOW} training episodes {_percent(late)}, "
        f"while exploring {_percent(early)}; {100 * RARELY:.0f} % at most is minimal",
    )


def _above_h_dqn(seeds: Sequence[Seed]) -> Claim:
    found = [
        [(s.hierarchical.late(name), s.h_dqn.late(name)) for name in MEASURES]
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
        [s.single_level.relative_spread(name) for name in ("speed", "reward")] for s in seeds
    ]
    return Claim(
        'The flat controller has "nearly constant average speed and reward in each episode"',
        tuple(max(pair) <= STEADY for pair in spreads),
        f"standard deviation over mean of the last {TRAINING_WINDOW} training episodes, nearly "
        f"constant up to {100 * STEADY:.0f} %: speed {_percent([pair[0] for pair in spreads])}, "
        f"reward a decision {_percent([pair[1] for pair in spreads])}",
    )


def _near_target(seeds: Sequence[Seed]) -> Claim:
    speeds = [s.hierarchical.final_speed for s in seeds]
    escaped = [bool(s.hierarchical.drive.escaped[-1]) for s in seeds]
    return Claim(
        'The hierarchical controller comes to "closely approach the target speed of 15m/s after '
        'overtaking"',
        tuple(
            out and abs(speed - TARGET_SPEED) <= NEAR
            for out, speed in zip(escaped, speeds, strict=True)
        ),
        f"mean speed in the last {ENDING:.0f} s of a drive: {_numbers(speeds)} m/s, "
        f"{sum(escaped)} of {len(seeds)} drives past the trap; within {NEAR:.0f} m/s is close",
    )


def _varies_more(seeds: Sequence[Seed]) -> Claim:
    spreads = [
        [(s.hierarchical.spread(name), s.single_level.spread(name)) for name in MEASURES]
        for s in seeds
    ]
    return Claim(
        'The hierarchical controller shows "greater variance in all of the evaluation criteria"',
        tuple(all(ours > flat for ours, flat in pairs) for pairs in spreads),
        f"standard deviation over the last {TRAINING_WINDOW} training episodes, mean over seeds: "
        f"{_against(spreads)}",
    )


def _exploring_more(seeds: Sequence[Seed]) -> Claim:
    rates = [max(more.late("success") for more in s.explorers) for s in seeds]
    flat = [s.single_level.late("success") for s in seeds]
    tested = [max(more.test_rate for more in s.explorers) for s in seeds]
    return Claim(
        'More initial exploration brings the flat controller "no significant enhancement"',
        tuple(more <= base + RARELY for more, base in zip(rates, flat, strict=True)),
        f"success in the last {TRAINING_WINDOW} training episodes: {_percent(flat)} without, "
        f"{_percent(rates)} for the better of the schedules; up to {100 * RARELY:.0f} points more "
        f"are no enhancement. In tests, with the weights kept: {_percent(tested)}",
    )


def _keeps_improving(seeds: Sequence[Seed]) -> Claim:
    settled = [s.hierarchical.around("success") for s in seeds]
    late = [s.hierarchical.late("success") for s in seeds]
    return Claim(
        'The hierarchical controller "continued to show enhancements even when the exploration '
        'value stabilized"',
        tuple(b > a for a, b in zip(settled, late, strict=True)),
        f"success in {TRAINING_WINDOW} training episodes: {_percent(settled)} when exploration "
        f"had ended, {_percent(late)} at the end",
    )


def _earns_more(seeds: Sequence[Seed]) -> Claim:
    found = [(s.hierarchical.rewards_at(LATER), s.single_level.rewards_at(LATER)) for s in seeds]
    return Claim(
        'By t = 9 s the hierarchical controller has "higher immediate and accumulated rewards"',
        tuple(all(a > b for a, b in zip(ours, flat, strict=True)) for ours, flat in found),
        "instant and accumulated reward, mean over seeds: hierarchical "
        f"{_numbers(np.mean([ours for ours, _ in found], axis=0))}, single-level "
        f"{_numbers(np.mean([flat for _, flat in found], axis=0))}",
    )


def _slows_more(seeds: Sequence[Seed]) -> Claim:
    lowest = [(s.hierarchical.lowest_speed, s.single_level.lowest_speed) for s in seeds]
    return Claim(
        "In the first 5 timesteps the speed reduction of the hierarchical controller is "
        '"more substantial"',
        tuple(ours < flat for ours, flat in lowest),
        "lowest speed: hierarchical "
        f"{_numbers([p[0] for p in lowest])}, single-level {_numbers([p[1] for p in lowest])} m/s",
    )


def _backs_off(seeds: Sequence[Seed]) -> Claim:
    """Both start at one speed, so whoever slows down falls back."""
    gaps = [s.single_level.gap for s in seeds]
    return Claim(
        'The flat controller slows down "to maintain a safe following distance", then speeds up '
        '"to minimize the gap"',
        tuple(g.max() > g[0] + MARGIN and g[-1] < g.max() - MARGIN for g in gaps),
        f"gap to the trap car ahead: {_numbers([g[0] for g in gaps])} m at the start, at most "
        f"{_numbers([g.max() for g in gaps])}, {_numbers([g[-1] for g in gaps])} at the end",
    )


def _escapes(seeds: Sequence[Seed]) -> Claim:
    rates = [(s.hierarchical.test_rate, s.single_level.test_rate) for s in seeds]
    return Claim(
        "In tests the hierarchical controller escapes (97.67 %) and the flat one does not (0 %)",
        tuple(ours > MOSTLY and flat <= RARELY for ours, flat in rates),
        _both(rates),
    )


def _more_accidents(seeds: Sequence[Seed]) -> Claim:
    rates = [(s.hierarchical.test_accidents, s.single_level.test_accidents) for s in seeds]
    return Claim(
        'The flat controller has "better performance in terms of the accident rate"',
        tuple(ours > flat for ours, flat in rates),
        f"in tests: {_both(rates)}",
    )


def _two_steps(seeds: Sequence[Seed]) -> Claim:
    pairs = [
        ((two.test_rate, two.test_reward), (one.test_rate, one.test_reward))
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


def _better(one: tuple[float, float], other: tuple[float, float]) -> bool:
    """Is one (success, reward) better than another by more than the margins, and never worse?"""
    success = (one[0] - other[0]) / MORE_SUCCESS
    reward = (one[1] - other[1]) / MORE_REWARD
    return max(success, reward) > 1 and min(success, reward) >= -1


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
