"""Kept weights beside the last ones: what is told of them, and when they are an outlier."""

import pytest

from lanewise.report import experiment_tables
from lanewise.runs import selected_weights


def lines(chosen=0.9, kept_success=0.9, last_success=0.9, kept_accidents=0.0, rule=None):
    """Metrics of a stage whose weights of chunk 2 of 3 were kept."""
    chunks = [
        {"kind": "chunk", "stage": "s", "chunk": number, "validation_success_rate": success}
        for number, success in ((1, 0.1), (2, chosen), (3, 0.2))
    ]
    figures = {
        **{f"{of}_reward": 1.0 for of in ("kept", "last")},
        **{f"{of}_accident_rate": 0.0 for of in ("kept", "last")},
        "kept_success_rate": kept_success,
        "last_success_rate": last_success,
        "kept_escape_rate": kept_success + kept_accidents,
        "last_escape_rate": last_success,
    } | {"kept_accident_rate": kept_accidents}
    of = {"stage": "s", "rule": rule or "best-validation", "kept_chunk": 2, "last_chunk": 3}
    return [*chunks, {"kind": "weights", **of, "fresh_episodes": 1000, **figures}]


@pytest.mark.parametrize(
    ("figures", "says"),
    [
        ({}, []),
        ({"kept_success": 0.86, "last_success": 0.7}, []),
        (
            {"chosen": 0.41, "kept_success": 0.4, "last_success": 0.0, "kept_accidents": 0.14},
            ["success 40.0 % with the kept weights, 0.0 % with the last ones"],
        ),
        ({"kept_accidents": 0.3}, ["accidents 30.0 % with the kept weights, 0.0 %"]),
        ({"kept_success": 0.8}, ["chosen for 90.0 % success, the kept weights of s have 80.0 %"]),
        ({"kept_success": 0.8, "rule": "best-training"}, []),
    ],
)
def test_weights_that_are_an_outlier_are_told(figures, says):
    (found,) = selected_weights.of_run(lines(**figures))
    warnings = list(found.warnings)
    assert len(warnings) == len(says)
    assert all(said in warning for said, warning in zip(says, warnings, strict=True))


def test_the_table_holds_kept_and_last_side_by_side():
    seeds = [selected_weights.of_run(lines(kept_success=share))[0] for share in (0.8, 1.0)]
    row = experiment_tables.weights({"an arm": seeds}).splitlines()[2]
    assert "| best-validation | 90.0 (90.0 to 90.0) | 90.0 (80.0 to 100.0) | 90.0 (90.0" in row
    assert row.count("|") == 3 + 2 * len(experiment_tables.WEIGHTS) + 1
