"""The paper's claims about its controllers, each computed from what an experiment measured.

A claim is looked at once a seed, from the seed's training episodes, its tests and one recorded
drive. It *holds* if every seed says so, *fails* if none does, and otherwise *depends*. Words in
quotation marks are the paper's.

Success is the paper's here: the ego's rear bumper passes the front of all trap cars before the
episode ends, whether or not an accident follows.
"""

from collections.abc import Callable, Sequence
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


@dataclass(frozen=True)
class PaperClaim:
    """Something the paper says, and how a seed supports it."""

    text: str
    measure: Callable[[Any], tuple[Any, ...]]
    """The measures of a `Seed` that it rests on."""
    holds: Callable[..., bool]
    """Whether it holds for a seed with these measures."""
    figures: Callable[..., str]
    """The same measures in words, each a sequence over the seeds."""
    needs: str = "hierarchical"
    """The field of a seed without which there is no evidence."""


def ledger(seeds: Sequence[Seed]) -> list[Claim]:
    """Every claim there is evidence for, each over the seeds that have it; none without a seed."""
    found = []
    for claim in CLAIMS.values():
        measured = [claim.measure(seed) for seed in seeds if getattr(seed, claim.needs)]
        if measured:
            holds = tuple(bool(claim.holds(*each)) for each in measured)
            found.append(Claim(claim.text, holds, claim.figures(*zip(*measured, strict=True))))
    return found


def _all_above(*pairs: tuple[float, float]) -> bool:
    """Is the first of each pair larger?"""
    return all(one > other for one, other in pairs)


def _better(success: float, reward: float, other_success: float, other_reward: float) -> bool:
    """Is one better than another by more than a margin, and worse by none?"""
    gains = (success - other_success) / MORE_SUCCESS, (reward - other_reward) / MORE_REWARD
    return max(gains) > 1 and min(gains) >= -1


def _percent(shares: Sequence[float]) -> str:
    mean = f"{100 * np.mean(shares):.1f} %"
    if len(shares) == 1:
        return mean
    return f"{mean} ({100 * min(shares):.1f} to {100 * max(shares):.1f})"


def _both(ours: Sequence[float], flat: Sequence[float]) -> str:
    return f"hierarchical {_percent(ours)}, single-level {_percent(flat)}"


def _against(*measures: Sequence[tuple[float, float]]) -> str:
    """Pairs of each measure, mean over seeds."""
    means = (np.mean(pairs, axis=0) for pairs in measures)
    return ", ".join(
        f"{name} {ours:.2g} against {other:.2g}"
        for name, (ours, other) in zip(MEASURES, means, strict=True)
    )


def _numbers(values: Any) -> str:
    return ", ".join(f"{value:.2f}" for value in values)


CLAIMS = {
    "early escapes": PaperClaim(
        'While exploring, both controllers "exhibited tendencies to escape"',
        lambda seed: (seed.hierarchical.early_success, seed.single_level.early_success),
        lambda ours, flat: ours > 0 and flat > 0,
        lambda ours, flat: (
            f"success until epsilon settles, in the first {EXPLORING} episodes at least: "
            f"{_both(ours, flat)}"
        ),
    ),
    "flat stops": PaperClaim(
        'As its exploration falls, the flat controller shows "a minimal probability of escaping"',
        lambda seed: (seed.single_level.early_success, seed.single_level.late("success")),
        lambda early, late: late <= RARELY,
        lambda early, late: (
            f"single-level success in the last {TRAINING_WINDOW} training episodes "
            f"{_percent(late)}, while exploring {_percent(early)}; {100 * RARELY:.0f} % at most is "
            "minimal"
        ),
    ),
    "above h-DQN": PaperClaim(
        'The hierarchical controller has a "higher likelihood" of escaping, "higher average '
        'rewards" and a "higher average speed" than h-DQN in training',
        lambda seed: tuple((seed.hierarchical.late(m), seed.h_dqn.late(m)) for m in MEASURES),
        _all_above,
        lambda *pairs: (
            f"means of the last {TRAINING_WINDOW} training episodes, mean over seeds, reward a "
            f"decision: {_against(*pairs)}"
        ),
        needs="h_dqn",
    ),
    "flat is steady": PaperClaim(
        'The flat controller has "nearly constant average speed and reward in each episode"',
        lambda seed: tuple(seed.single_level.relative_spread(m) for m in ("speed", "reward")),
        lambda speed, reward: max(speed, reward) <= STEADY,
        lambda speed, reward: (
            f"standard deviation over mean of the last {TRAINING_WINDOW} training episodes, nearly "
            f"constant up to {100 * STEADY:.0f} %: speed {_percent(speed)}, reward a decision "
            f"{_percent(reward)}"
        ),
    ),
    "near the target": PaperClaim(
        'The hierarchical controller comes to "closely approach the target speed of 15m/s after '
        'overtaking"',
        lambda seed: (seed.hierarchical.final_speed, seed.hierarchical.drive.escaped[-1]),
        lambda speed, escaped: escaped and abs(speed - TARGET_SPEED) <= NEAR,
        lambda speeds, escaped: (
            f"mean speed in the last {ENDING:.0f} s of a drive: {_numbers(speeds)} m/s, "
            f"{sum(escaped)} of {len(escaped)} drives past the trap; within {NEAR:.0f} m/s is close"
        ),
    ),
    "varies more": PaperClaim(
        'The hierarchical controller shows "greater variance in all of the evaluation criteria"',
        lambda seed: tuple(
            (seed.hierarchical.spread(m), seed.single_level.spread(m)) for m in MEASURES
        ),
        _all_above,
        lambda *pairs: (
            f"standard deviation over the last {TRAINING_WINDOW} training episodes, mean over "
            f"seeds: {_against(*pairs)}"
        ),
    ),
    "exploring more": PaperClaim(
        'More initial exploration brings the flat controller "no significant enhancement"',
        lambda seed: (
            seed.single_level.late("success"),
            max(more.late("success") for more in seed.explorers),
            max(more.test["escape_rate"] for more in seed.explorers),
        ),
        lambda flat, more, tested: more <= flat + RARELY,
        lambda flat, more, tested: (
            f"success in the last {TRAINING_WINDOW} training episodes: {_percent(flat)} without, "
            f"{_percent(more)} for the better of the schedules; up to {100 * RARELY:.0f} points "
            f"more are no enhancement. In tests, with the weights kept: {_percent(tested)}"
        ),
        needs="explorers",
    ),
    "keeps improving": PaperClaim(
        'The hierarchical controller "continued to show enhancements even when the exploration '
        'value stabilized"',
        lambda seed: (seed.hierarchical.around("success"), seed.hierarchical.late("success")),
        lambda settled, late: late > settled,
        lambda settled, late: (
            f"success in {TRAINING_WINDOW} training episodes: {_percent(settled)} when exploration "
            f"had ended, {_percent(late)} at the end"
        ),
    ),
    "earns more": PaperClaim(
        'By t = 9 s the hierarchical controller has "higher immediate and accumulated rewards"',
        lambda seed: (seed.hierarchical.rewards_at(LATER), seed.single_level.rewards_at(LATER)),
        lambda ours, flat: _all_above(*zip(ours, flat, strict=True)),
        lambda ours, flat: (
            "instant and accumulated reward, mean over seeds: hierarchical "
            f"{_numbers(np.mean(ours, axis=0))}, single-level {_numbers(np.mean(flat, axis=0))}"
        ),
    ),
    "slows more": PaperClaim(
        "In the first 5 timesteps the speed reduction of the hierarchical controller is "
        '"more substantial"',
        lambda seed: (seed.hierarchical.lowest_speed, seed.single_level.lowest_speed),
        lambda ours, flat: ours < flat,
        lambda ours, flat: (
            f"lowest speed: hierarchical {_numbers(ours)}, single-level {_numbers(flat)} m/s"
        ),
    ),
    # Both start at one speed, so whoever slows down falls back.
    "backs off": PaperClaim(
        'The flat controller slows down "to maintain a safe following distance", then speeds up '
        '"to minimize the gap"',
        lambda seed: seed.single_level.gaps,
        lambda first, most, last: most > first + MARGIN and last < most - MARGIN,
        lambda first, most, last: (
            f"gap to the trap car ahead: {_numbers(first)} m at the start, at most "
            f"{_numbers(most)}, {_numbers(last)} at the end"
        ),
    ),
    "escapes": PaperClaim(
        "In tests the hierarchical controller escapes (97.67 %) and the flat one does not (0 %)",
        lambda seed: (seed.hierarchical.test["escape_rate"], seed.single_level.test["escape_rate"]),
        lambda ours, flat: ours > MOSTLY and flat <= RARELY,
        _both,
    ),
    "more accidents": PaperClaim(
        'The flat controller has "better performance in terms of the accident rate"',
        lambda seed: (
            seed.hierarchical.test["accident_rate"],
            seed.single_level.test["accident_rate"],
        ),
        lambda ours, flat: ours > flat,
        lambda ours, flat: f"in tests: {_both(ours, flat)}",
    ),
    "two steps": PaperClaim(
        'Two steps are needed "to enhance the controller\'s effectiveness"',
        lambda seed: (
            *(seed.hierarchical.test["escape_rate"], seed.hierarchical.test["accumulated_reward"]),
            *(seed.one_step.test["escape_rate"], seed.one_step.test["accumulated_reward"]),
        ),
        _better,
        lambda success, reward, success_of_one, reward_of_one: (
            f"in tests, two steps against one: success {_percent(success)} against "
            f"{_percent(success_of_one)}, reward {np.mean(reward):.2f} against "
            f"{np.mean(reward_of_one):.2f}; better is by more than {100 * MORE_SUCCESS:.0f} points "
            f"or {MORE_REWARD:.1f}, and in neither worse by as much"
        ),
        needs="one_step",
    ),
}
"""Every claim, in the order of the paper's experiments; its second contribution last."""
