"""Wrong settings: a small part of the campaign, through the same functions."""

import random
from dataclasses import replace

import pytest
import wrong_doors
import wrong_settings
from wrong_doors import Met, Mistake

SEED, EACH = 3, 2


@pytest.fixture(scope="module")
def mistakes():
    """First those of the doors that need no JAX."""
    light, others = wrong_settings.split(wrong_settings.generate(SEED, EACH))
    return light + others


@pytest.fixture(scope="module")
def found(mistakes):
    """What became of all of them, the light ones in a process of their own."""
    _, others = wrong_settings.split(mistakes)
    met = wrong_settings.apart(SEED, EACH) + wrong_settings.run(others)
    return wrong_settings.figures(mistakes, met)


def test_every_mistake_is_refused_before_anything_starts(found):
    assert found["mistakes"] > 500
    assert found["let_in"] == []
    assert found["refused"] == found["mistakes"]


def test_the_hint_is_right(found):
    assert found["hint_rate"] >= wrong_settings.AIM, found["without_the_right_hint"]


def test_every_kind_of_mistake_is_made_at_every_door(found):
    kinds = {"misspelt", "wrong type", "out of range", "impossible"}
    assert found["by_kind_and_door"].keys() == kinds
    for kind, doors in found["by_kind_and_door"].items():
        assert doors.keys() >= set(wrong_doors.SETTING_DOORS), kind
        assert all(door["made"] for door in doors.values())


def test_a_process_of_its_own_leaves_nothing(mistakes):
    programs = [mistake for mistake in mistakes if mistake.door in wrong_doors.COMMANDS]
    assert wrong_settings.fresh(random.Random(SEED).sample(programs, 2)) == []


def test_the_campaign_sees_what_is_let_in():
    right = {"scenario.lanes": 4}
    doors = ("compose", "gymnasium.make", "lanewise.train", "command line")
    given = (right, right, right, [*wrong_doors.TRAIN, "--scenario.lanes", "4"])
    let_in = [Mistake("out of range", "none", *each) for each in zip(doors, given, strict=True)]
    figures = wrong_settings.figures(let_in, wrong_settings.run(let_in))
    assert figures["refused"] == 0
    assert len(figures["let_in"]) == len(let_in)


@pytest.mark.parametrize(
    ("given", "wrong"),
    [
        (["train", "hierarchical", "--out", "new"], "left behind: ['new']"),
        (["train"], "imported ['jax']"),
        (["watch"], "ZeroDivisionError instead of an error for people"),
        (["sweep"], "a message of more than two lines, or too long ones"),
    ],
)
def test_the_campaign_sees_what_begins(monkeypatch, given, wrong):
    """Commands that refuse, but not as they should."""

    def refuse(words):
        if words[-1] == "new":
            (wrong_doors.Path("new")).mkdir()
        elif words == ["train"]:
            monkeypatch.setitem(wrong_doors.sys.modules, "jax", object())
        elif words == ["watch"]:
            return 1 / 0
        message = "x" * 300 if words == ["sweep"] else "no"
        wrong_doors.sys.stderr.write(f"lanewise: error: {message}\n")
        return 2

    if given == ["train"]:
        monkeypatch.delitem(wrong_doors.sys.modules, "jax", raising=False)
    monkeypatch.setattr(wrong_doors, "main", refuse)
    mistake = Mistake("misspelt", "", "command", given)
    (met,) = wrong_settings.run([mistake])
    assert met.wrong == wrong
    assert wrong_settings.figures([mistake], [met])["let_in"][0]["wrong"] == wrong


def test_the_campaign_sees_a_wrong_hint():
    mistake = Mistake("misspelt", "", "compose", {}, (("scenario.lanes",),))
    for message, right in (
        ('unknown setting "scenario.laness"; did you mean scenario.lanes?', True),
        ('unknown option "--scenario.laness"; did you mean --scenario.lanes?', True),
        ('unknown setting "scenario.lanes"; did you mean scenario.lane_width?', False),
        ('unknown setting "x"; did you mean scenario.lanes_closed?', False),
        ('unknown setting "x"; did you mean lanes?', False),
    ):
        assert wrong_settings.hinted(mistake, message) is right, message
    both = replace(mistake, kind="impossible", hint=(("a.b", "a.c"), ("10",)))
    assert wrong_settings.hinted(both, "a.c must be at most 10, got 11")
    assert not wrong_settings.hinted(both, "a.c must be at most 100")
    assert not wrong_settings.hinted(both, "a.b.c must be at most 10")
    figures = wrong_settings.figures([both], [Met(True, "something is wrong")])
    assert figures["hint_rate"] == 0
    assert len(figures["without_the_right_hint"]) == 1
