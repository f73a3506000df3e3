"""Anyone's policy as a function of batches: what it is asked, and which answers are refused."""

import numpy as np
import pytest

from lanewise.errors import LanewiseError
from lanewise.evaluation import external_policy

SEEN = np.zeros((4, 26), np.float32)
ALL = np.ones(4, bool)


class Predicts:
    def __init__(self, answer):
        self.answer = answer

    def predict(self, observation):
        return self.answer(observation)


class Remembers:
    """Goes straight on, and harder to the right the more often it was asked."""

    def __init__(self, batched):
        self.asked, self.batched = 0, batched

    def __call__(self, seen):
        if not self.batched:
            assert seen.shape == (26,)
        self.asked += 1
        action = 4 if self.asked < (30 if self.batched else 30 * len(SEEN)) else 5
        return np.full(len(seen), action) if self.batched else action


@pytest.mark.parametrize("batched", [True, False])
def test_a_function_that_remembers_is_told_how_to(batched):
    decide = external_policy.decider(Remembers(batched), batched, 9)
    said = r"with 4 and later with 5.*\n.* an object with predict\(observation, state"
    for decision in range(31):
        decide(SEEN, ALL, decision == 0)
    with pytest.raises(LanewiseError, match=said) as refused:
        decide(SEEN, ALL, False)
    assert len(str(refused.value).splitlines()) == 2


def test_a_function_that_draws_is_tested_where_it_says_so():
    chance = np.random.default_rng(0)

    def at_random(seen):
        return chance.integers(9, size=len(seen))

    for deterministic in (False, True):
        decide = external_policy.decider(at_random, None, 9, deterministic)
        if not deterministic:
            assert len({tuple(decide(SEEN, ALL, False)) for _ in range(9)}) > 1
    with pytest.raises(LanewiseError, match="draws at random, deterministic=False"):
        decide(SEEN, ALL, True)


def test_continuous_answers_may_differ_by_rounding():
    asked = []

    def rounding(seen):
        asked.append(seen)
        return np.full((len(seen), 2), 0.5 + 1e-6 * (len(asked) % 2))

    decide = external_policy.decider(rounding, True, 0)
    for decision in range(8):
        decide(SEEN, ALL, decision == 0)


# `tests/envs/test_single.py` has a list of what is no action.
RETURNED = {
    "beyond the limit": (0, lambda seen: np.full((len(seen), 2), 1.5)),
    "shape": (9, lambda seen: np.zeros((7, 3))),
    "unknown": (9, lambda seen: np.full(len(seen), 9)),
    "ragged": (9, lambda seen: [[4]] + [[4, 4]] * (len(seen) - 1)),
    "one text": (9, lambda seen: "4"),
    "nothing": (9, lambda seen: None),
    "one shape, then another": (9, lambda seen: [4] * (1 + (seen[0] > 0))),
}


@pytest.mark.parametrize(("count", "policy"), RETURNED.values(), ids=list(RETURNED))
def test_what_is_no_action_is_refused_in_a_line(count, policy):
    for given, batched in ((policy, None), (policy, True), (Predicts(policy), None)):
        decide = external_policy.decider(given, batched, count)
        with pytest.raises(LanewiseError, match="the policy must return") as refused:
            decide(SEEN, ALL, True)
        assert len(str(refused.value).splitlines()) == 1


def test_predict_returns_actions_and_at_most_a_state():
    decide = external_policy.decider(Predicts(lambda seen: (seen[:, 0], None, None)), None, 9)
    with pytest.raises(LanewiseError, match=r"predict\(\) .* it returned 3 values"):
        decide(SEEN, ALL, True)


def test_a_policy_that_fails_says_so_itself():
    def failing(seen):
        raise RuntimeError("out of ideas")

    decide = external_policy.decider(failing, None, 9)
    with pytest.raises(RuntimeError, match="out of ideas"):
        decide(SEEN, ALL, True)
