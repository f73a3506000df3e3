"""Training computes what it computed when its results were stored; `first_updates.py` says more."""

import json

import first_updates
import pytest

from lanewise.system import version

TOLERANCE = 0.02
"""Relative. Code for a processor without fused multiply-add stays within half of it."""
QUICK = ("step-1", "single-level")


@pytest.mark.parametrize(
    "arm",
    [
        pytest.param(arm, marks=() if arm in QUICK else pytest.mark.slow)
        for arm in first_updates.ARMS
    ],
)
def test_first_updates_of(arm):
    stored = json.loads(version.FIRST_UPDATES.read_text("utf-8"))
    assert differences(stored[arm], first_updates.first_updates(arm)) == []


@pytest.mark.parametrize("changed", [{"loss": 1.0}, {"loss": 1.0, "mean_q": -2.1}, {}])
def test_a_difference_is_named(changed):
    stored = {"chunks": [{"loss": 1.05, "mean_q": -2.0, "updates": 0}]}
    found = {"chunks": [stored["chunks"][0] | changed]}
    assert differences(stored, found) == [f"chunks/0/{name}" for name in changed]


def differences(stored, found, place=""):
    """Where two results differ by more than the tolerance, or in form."""
    if isinstance(stored, dict):
        if stored.keys() != found.keys():
            return [place]
        return [
            each
            for name in stored
            for each in differences(stored[name], found[name], f"{place}/{name}".lstrip("/"))
        ]
    if isinstance(stored, list):
        if len(stored) != len(found):
            return [place]
        pairs = enumerate(zip(stored, found, strict=True))
        return [
            each
            for number, (one, other) in pairs
            for each in differences(one, other, f"{place}/{number}")
        ]
    close = found == stored or abs(found - stored) <= TOLERANCE * abs(stored)
    return [] if close else [place]
