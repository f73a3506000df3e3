"""The ledger of claims on drives made by hand, for which the verdicts are plain."""

from dataclasses import replace

import numpy as np
import pytest

from lanewise.evaluation.episodes import Episodes, Recording
from lanewise.experiments import claims
from lanewise.experiments.claims import Evidence, Seed


def training(success, reward=1.0, speed=10.0, noise=0.0):
    """Episodes whose success is given one by one."""
    rng = np.random.default_rng(0)
    return [
        {
            "success": bool(s),
            "reward": 100 * (reward + noise * rng.normal()),
            "decisions": 100,
            "speed": speed + noise * rng.normal(),
        }
        for s in success
    ]


def outcomes(success, accidents, count=100):
    zero = np.zeros(count)
    return Episodes(
        success=np.arange(count) < success,
        accident=(np.arange(count) >= count - accidents).astype(np.int8),
        accumulated_reward=zero,
        average_speed=zero,
        travel_distance=zero,
        duration=zero,
        escape_time=zero,
        goals=zero.astype(int),
        goals_timed_out=zero.astype(int),
    )


def recording(speed, reward, gap):
    """Twenty-one frames, 10 s, of an ego and the trap car ahead of it."""
    frames = 21
    speeds = np.interp(np.arange(frames), np.linspace(0, frames - 1, len(speed)), speed)
    gaps = np.interp(np.arange(frames), np.linspace(0, frames - 1, len(gap)), gap)
    x = np.stack([-gaps, np.zeros(frames)], axis=1)
    filler = dict.fromkeys(Recording.__dataclass_fields__)
    return Recording(
        **filler
        | {
            "time": np.arange(frames) / 2,
            "x": x,
            "speed": np.stack([speeds, speeds], axis=1),
            "reward": np.full(frames, reward),
            "accumulated_reward": np.arange(frames) * reward / 2,
        }
    )


OURS = Evidence(
    training([1, 0, 0, 0, 0] * 20 + [1, 0] * 100, noise=0.5),
    100,
    outcomes(98, 2),
    recording([10, 8, 14], 0.9, [15, 20, -30]),
)
FLAT = Evidence(
    training([1, 0, 0, 0, 0] * 20 + [0] * 200),
    100,
    outcomes(0, 0),
    recording([10, 9.5, 10], 0.2, [15, 18, 16]),
)
PAPER = Seed(0, OURS, FLAT, (FLAT, FLAT))
OPPOSITE = Seed(1, FLAT, OURS, (OURS,))


def verdicts(*seeds):
    return [claim.verdict for claim in claims.ledger(seeds)]


def test_what_the_paper_describes_holds():
    assert verdicts(PAPER) == ["holds"] * len(claims.CLAIMS)


def test_the_opposite_fails_but_for_what_both_do():
    """Early escapes are in both; with the roles swapped nothing else is as the paper says."""
    forward = replace(OURS, recording=recording([10, 8, 14], 0.9, [15, 15, -30]))
    swapped = replace(OPPOSITE, single_level=replace(forward, test=outcomes(0, 2)))
    assert verdicts(swapped) == ["holds"] + ["fails"] * (len(claims.CLAIMS) - 1)


def test_seeds_that_disagree_make_it_depend():
    found = claims.ledger((PAPER, OPPOSITE))
    assert found[1].seeds == (True, False)
    assert found[1].verdict == "depends"
    assert found[0].verdict == "holds"


@pytest.mark.parametrize(
    ("change", "number"),
    [
        ({"hierarchical": replace(OURS, training=training([0] * 300))}, 0),
        ({"single_level": replace(FLAT, training=training([1] * 100 + [1, 0] * 100))}, 1),
        ({"explorers": (FLAT, replace(FLAT, test=outcomes(50, 0)))}, 2),
        ({"hierarchical": replace(OURS, settled=300)}, 3),
        ({"single_level": replace(FLAT, training=training([0] * 300, noise=9.0))}, 4),
        ({"single_level": replace(FLAT, recording=recording([10, 7, 7], 0.2, [15, 18, 16]))}, 5),
        ({"hierarchical": replace(OURS, recording=recording([10, 8], 0.1, [15, 9]))}, 6),
        ({"single_level": replace(FLAT, recording=recording([10, 9.5], 0.2, [15, 18]))}, 7),
        ({"single_level": replace(FLAT, test=outcomes(0, 3))}, 8),
    ],
)
def test_each_claim_fails_on_its_own_evidence(change, number):
    found = claims.ledger([replace(PAPER, **change)])
    assert found[number].verdict == "fails", found[number]


def test_no_evidence_no_claims():
    assert claims.ledger([]) == []
    without = claims.ledger([replace(PAPER, explorers=())])
    assert len(without) == len(claims.CLAIMS) - 1
    assert not any("exploration does not help" in claim.text for claim in without)


def test_exploring_more_is_asked_of_the_seeds_that_did():
    found = claims.ledger((PAPER, replace(PAPER, seed=1, explorers=())))
    (claim,) = (c for c in found if "exploration does not help" in c.text)
    assert (claim.verdict, claim.seeds) == ("holds", (True,))
