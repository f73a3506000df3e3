"""Wrong settings, made from every field's type and range, are refused at every door users have.

Refused well: before anything starts, in one or two lines, with the name, the type or the range.
"""

import contextlib
import io
import json
import math
import re

import gymnasium
import pytest

import lanewise
from lanewise import config
from lanewise.cli.main import main
from lanewise.errors import LanewiseError

SETTINGS = config.flatten(config.compose())
FIELDS = config.field_types()
NOUNS = {int: "whole number", float: "number", bool: "true or false"}
TRAIN = ("train", "hierarchical", "--out", "taken")
"""The folder is taken, so that a mistake that is let in starts nothing."""
ENVIRONMENT = ("scenario.", "driving.", "goals.", "planner.")
"""Sections that an environment takes."""


def toml(value):
    """A value as a TOML file writes it."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{name} = {toml(each)}" for name, each in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(toml, value)) + "]"
    return repr(value) if isinstance(value, float) else json.dumps(value)


def wrong_values(name):
    """(value, what the message must hold) of values that a setting cannot have."""
    field = FIELDS[name]
    options = getattr(field.bound, "names", ())
    hint = options or (NOUNS[field.type],)
    wrong = ["many", {"value": 1}, *([True] if field.type is not bool else [1, "yes"])]
    if field.type is int:
        wrong += [2.5, 2.0]
    if field.length is not None:
        wrong = [[value] * (field.length or 1) for value in wrong]
        wrong += [15, "15 16"]
        wrong += [[SETTINGS[name][0]] * 3] if field.length == 2 and SETTINGS[name] else []
    for value in wrong:
        yield value, hint
    low, high = (getattr(field.bound, side, None) for side in ("low", "high"))
    if low is None:
        return
    bounds = [re.sub(r"\.0$", "", repr(bound)) for bound in (low, high)]
    below, above = low - 1, high + 1
    if field.type is float:
        below, above = math.nextafter(low, -math.inf), math.nextafter(high, math.inf)
    beyond = [field.type(-(10**12)), below, above, 10**400]
    beyond += [math.nan, math.inf] if field.type is float else []
    for value in beyond:
        yield (value if field.length is None else [value] * (field.length or 1)), bounds


def slips(name):
    """Misspelt names: a letter less, two letters swapped, another separator, no section."""
    owner, _, leaf = name.rpartition(".")
    middle = len(leaf) // 2
    swapped = leaf[: middle - 1] + leaf[middle] + leaf[middle - 1] + leaf[middle + 1 :]
    spelt = {f"{owner}.{leaf[:middle] + leaf[middle + 1 :]}", f"{owner}.{swapped}", name.upper()}
    return sorted((spelt | {name.replace(".", "/"), f"{owner}.{leaf}s"}) - set(FIELDS))


def by_command(words):
    """The refusal of a command line, in this process."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main([str(word) for word in words])
    said = err.getvalue().removeprefix("lanewise: error: ")
    return said if code == 2 and said != err.getvalue() and not out.getvalue() else "let in"


def by_python(call, *arguments, **named):
    try:
        with contextlib.redirect_stderr(io.StringIO()):
            call(*arguments, **named)
    except LanewiseError as error:
        return str(error)
    return "let in"


def command_line(name, value):
    words = value if isinstance(value, list | tuple) else [value]
    words = [toml(word).strip('"') for word in words]
    return by_command([*TRAIN, "--" + name.replace("_", "-"), *(words or ["none"])])


def file(name, value):
    owner, _, leaf = name.rpartition(".")
    quoted = f'"{leaf}"' if re.search("[^A-Za-z0-9_-]", leaf) else leaf
    with open("wrong.toml", "w") as opened:
        opened.write(f"[{owner}]\n{quoted} = {toml(value)}\n" if owner else f'"{leaf}" = 1\n')
    return by_command([*TRAIN, "--settings", "wrong.toml"])


def experiment(name, value):
    with open("wrong.toml", "w") as opened:
        opened.write("seeds = 1\nepisodes = 1\nhighway_env_episodes = 0\n[arms.one]\n")
        opened.write('controller = "hierarchical"\n[arms.one.settings]\n')
        opened.write(f'"{name}" = {toml(value)}\n')
    return by_command(["reproduce", "--out", "taken", "--experiment", "wrong.toml"])


DOORS = {
    "compose": lambda name, value: by_python(config.compose, flags={name: value}),
    "lanewise.train": lambda name, value: by_python(lanewise.train, "taken", **{name: value}),
    "gymnasium.make": lambda name, value: by_python(
        gymnasium.make, "lanewise/Trap-v0", **{name: value}
    ),
    "command line": command_line,
    "file": file,
    "experiment": experiment,
}


@pytest.fixture(autouse=True)
def nothing_left(tmp_path, monkeypatch):
    """Work in a folder that holds one that is taken, and nothing else afterwards."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "taken").mkdir()
    (tmp_path / "taken" / "notes.txt").write_text("mine")
    yield
    left = {str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*")}
    assert left - {"wrong.toml"} == {"taken", "taken/notes.txt"}


def names_of(door):
    """The settings tried at a door: every so many."""
    if door == "gymnasium.make":
        return [name for name in FIELDS if name.startswith(ENVIRONMENT)][::2]
    return list(FIELDS)[:: 2 if door == "compose" else 9]


def is_refused_well(message):
    lines = message.splitlines()
    return 1 <= len(lines) <= 2 and max(map(len, lines)) <= 250 and message != "let in"


@pytest.mark.parametrize("door", DOORS)
def test_wrong_values(door):
    wrong, tried = [], 0
    for name in names_of(door):
        for value, hint in wrong_values(name):
            # What a command line cannot say: a table, or one value for a list.
            listed = FIELDS[name].length is not None
            if door == "command line" and ("{" in toml(value) or listed != isinstance(value, list)):
                continue
            message = DOORS[door](name, value)
            tried += 1
            told = name.replace("_", "-") in message or name in message
            if not (is_refused_well(message) and told and all(each in message for each in hint)):
                wrong.append((name, str(value)[:40], message))
    assert wrong == []
    assert tried > 100


@pytest.mark.parametrize("door", DOORS)
def test_misspelt_names(door):
    found = []
    for name in names_of(door):
        for spelt in slips(name):
            message = DOORS[door](spelt, SETTINGS[name])
            assert is_refused_well(message), (spelt, message)
            owner, meant = name.rpartition(".")[0], name
            if door == "file" and spelt.rpartition(".")[0] not in ("", owner):
                meant = owner.split(".")[0]  # The section is what is misspelt.
            plain = message.replace("--", "").replace("-", "_")
            found.append(re.search(rf"(?<![\w.]){re.escape(meant)}(?![\w])", plain) is not None)
    assert sum(found) >= 0.95 * len(found)
    assert len(found) > 50


def test_a_right_setting_is_let_in():
    assert DOORS["compose"]("scenario.lanes", 4) == "let in"
    assert "taken" in DOORS["command line"]("scenario.lanes", 4)
