"""The ledger of claims on drives made by hand, for which the verdicts are plain."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from lanewise.evaluation import metrics
from lanewise.evaluation.episodes import Recording
from lanewise.experiments import claims, reporting
from lanewise.experiments.claims import Seed
from lanewise.experiments.evidence import Evidence
from untrusted_files import made_up_episodes


def training(success, reward=1.0, speed=10.0, noise=0.0):
    """Episodes whose success is given one by one."""
    rng = np.random.default_rng(0)
    return [
        {
            "success": bool(s),
            "escaped": bool(s),
            "reward": 100 * (reward + noise * rng.normal()),
            "decisions": 100,
            "speed": speed + noise * rng.normal(),
        }
        for s in success
    ]


def outcomes(success, accidents, count=100, reward=0.0):
    """Tests in which those that had an accident are the last; whoever succeeds escaped at 9 s."""
    number = np.arange(count)
    episodes = replace(
        made_up_episodes(0, count),
        success=number < success,
        accident=(number >= count - accidents).astype(np.int8),
        accumulated_reward=np.full(count, reward),
        escape_time=np.where(number < success, 9.0, np.nan),
    )
    return metrics.summarise(episodes, controller="any", world="lanewise").values


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
            "escaped": np.logical_or.accumulate(gaps < -5),
        }
    )


OURS = Evidence(
    training([1, 0, 0, 0, 0] * 20 + [1, 0] * 100, reward=2.0, speed=13.0, noise=0.5),
    100,
    outcomes(98, 2, reward=13.0),
    recording([10, 8, 15, 15, 15], 0.9, [15, 20, -30]),
)
FLAT = Evidence(
    training([1, 0, 0, 0, 0] * 20 + [0] * 200),
    100,
    outcomes(0, 0, reward=3.0),
    recording([10, 9.5, 10], 0.2, [15, 18, 16]),
)
PAPER = Seed(OURS, FLAT, (FLAT, FLAT), h_dqn=FLAT, one_step=FLAT)
OPPOSITE = Seed(FLAT, OURS, (OURS,), h_dqn=OURS, one_step=OURS)
OPTIONAL = {"explorers": (), "h_dqn": None, "one_step": None}
"""Fields of a seed whose arms an experiment may lack, each asked for by one claim."""


def verdicts(*seeds):
    return [claim.verdict for claim in claims.ledger(seeds)]


def found(claim, **change):
    """A claim of the ledger over the paper's seed with other evidence."""
    return claims.ledger([replace(PAPER, **change)])[list(claims.CLAIMS).index(claim)]


def test_what_the_paper_describes_holds():
    assert verdicts(PAPER) == ["holds"] * len(claims.CLAIMS)


def test_seeds_that_disagree_make_it_depend():
    early, stops, *_ = claims.ledger((PAPER, OPPOSITE))
    assert stops.seeds == (True, False)
    assert stops.verdict == "depends"
    assert early.verdict == "holds"


def ours(**change):
    return {"hierarchical": replace(OURS, **change)}


def flat(**change):
    return {"single_level": replace(FLAT, **change)}


@pytest.mark.parametrize(
    ("claim", "change"),
    [
        # In each of the measures.
        ("above h-DQN", {"h_dqn": replace(FLAT, training=training([1] * 300))}),
        ("above h-DQN", {"h_dqn": replace(FLAT, training=training([0] * 300, reward=3.0))}),
        ("early escapes", ours(training=training([0] * 300))),
        ("flat stops", flat(training=training([1] * 100 + [1, 0] * 100))),
        ("flat is steady", flat(training=training([0] * 300, noise=0.5))),
        (
            "exploring more",
            {"explorers": (FLAT, replace(FLAT, training=training([0] * 200 + [1, 0] * 50)))},
        ),
        ("keeps improving", ours(settled=300)),
        ("varies more", flat(training=training([0] * 300, noise=9.0))),
        ("slows more", flat(recording=recording([10, 7, 7], 0.2, [15, 18, 16]))),
        ("earns more", ours(recording=recording([10, 8], 0.1, [15, 9]))),
        ("backs off", flat(recording=recording([10, 9.5], 0.2, [15, 18]))),
        ("more accidents", flat(test=outcomes(0, 3))),
        # More than nine tenths against at most 2 %.
        ("escapes", ours(test=outcomes(90, 0))),
        ("escapes", flat(test=outcomes(3, 0))),
        # By 10 points of success or 1.0 of reward; better in one and worse in the other is not
        # better. The hierarchical arm has 98 % and 13.0.
        ("two steps", {"one_step": replace(FLAT, test=outcomes(87, 0, reward=14.1))}),
    ],
)
def test_each_claim_fails_on_its_own_evidence(claim, change):
    assert found(claim, **change).verdict == "fails"


def test_claims_hold_up_to_their_limits():
    limits = ours(test=outcomes(91, 0)) | flat(test=outcomes(2, 0))
    assert found("escapes", **limits).verdict == "holds"
    one = replace(FLAT, test=outcomes(100, 0, reward=11.5))
    assert found("two steps", one_step=one).verdict == "holds"


def test_an_escape_counts_whatever_happens_later():
    """The paper's success has no clause about accidents: in tests, and in training if recorded."""
    crashed = outcomes(98, 98) | {"success_rate": 0.0}
    claim = found("escapes", **ours(test=crashed))
    assert claim.verdict == "holds"
    assert claim.figures == "hierarchical 98.0 %, single-level 0.0 %"
    late = [line | {"escaped": True} for line in FLAT.training]
    assert found("flat stops", **flat(training=late)).verdict == "fails"


def test_no_evidence_no_claims():
    assert claims.ledger([]) == []
    bare = claims.ledger([replace(PAPER, **OPTIONAL)])
    assert len(bare) == len(claims.CLAIMS) - len(OPTIONAL)
    for name, nothing in OPTIONAL.items():
        without = claims.ledger([replace(PAPER, **{name: nothing})])
        assert len(without) == len(claims.CLAIMS) - 1, name


def test_a_report_finds_the_arms_that_claims_speak_of(monkeypatch):
    """By their names; seeds that only the other arms have are left out."""
    held = {"hierarchical": OURS, "single-level": FLAT, "h-dqn": FLAT, "one-step": OURS}
    monkeypatch.setattr(reporting, "_evidence", lambda seed, seconds=None: held[seed.arm])
    results = [
        SimpleNamespace(
            arm=SimpleNamespace(name=name),
            seeds=[SimpleNamespace(arm=name, job=SimpleNamespace(seed=seed)) for seed in seeds],
        )
        for name, seeds in zip(held, ([0, 1], [0, 1], [0], [0, 2]), strict=True)
    ]
    first = Seed(OURS, FLAT, h_dqn=FLAT, one_step=OURS)
    assert reporting._ledger(results) == claims.ledger([first, Seed(OURS, FLAT)])
