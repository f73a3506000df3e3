"""The doors through which settings come in, and what happens to a mistake behind each.

No door may be let go through by mistake: a command is given a folder that is taken, so that what is
not refused for its settings is refused for that, which counts as not refused.
"""

import contextlib
import io
import os
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lanewise import config
from lanewise.cli.main import main
from lanewise.errors import LanewiseError

TAKEN = "taken"
"""A folder that holds something, so that nothing can begin in it."""
LET_IN = ("holds no run", "no run in", "exists; choose another")
"""Messages that come after the settings were accepted."""
HEAVY = ("jax", "jaxlib", "optax", "highway_env", "gymnasium")
TRAIN = ("train", "hierarchical", "--out", TAKEN)
COMMANDS = ("command line", "file", "experiment", "command")
"""Doors of the program `lanewise`."""
LIGHT = (*COMMANDS, "compose")
"""Doors that need no JAX, so it must not be there after a refusal."""


@dataclass(frozen=True)
class Mistake:
    """Something a user might write."""

    kind: str
    how: str
    """In words."""
    door: str
    given: Any
    """What the door is handed."""
    hint: tuple[tuple[str, ...], ...] = field(default=())
    """Of each group, one text must stand in the message as a word of its own."""


@dataclass(frozen=True)
class Met:
    """What became of a mistake."""

    refused: bool
    """With an error for people and exit code 2."""
    message: str
    wrong: str = ""
    """What went wrong besides: a traceback, a file left behind, JAX imported, a long message."""


def toml(assignments):
    """A TOML text of dotted names, the last word quoted where it is no bare key."""
    lines = []
    for name, value in assignments.items():
        owner, _, leaf = name.rpartition(".")
        lines += [f"[{_key(owner)}]"] if owner else []
        lines.append(f"{_key(leaf)} = {value}")
    return "\n".join(lines) + "\n"


def _key(name):
    """Dotted parts, quoted where they must be."""
    bare = [part.replace("_", "").replace("-", "").isalnum() for part in name.split(".")]
    parts = zip(name.split("."), bare, strict=True)
    return ".".join(part if plain else f'"{part}"' for part, plain in parts)


def given(door, name, value):
    """What a door is handed to set ``name`` to a `Wrong` value; None where it cannot be said."""
    if door == "command line":
        flag = "--" + name.replace("_", "-")
        return None if value.words is None else [*TRAIN, flag, *value.words]
    if door == "file":
        return None if value.toml is None else toml({name: value.toml})
    if door == "experiment":
        return None if value.toml is None else experiment({name: value.toml})
    return {name: value.python}


def together(door, flags):
    """What a door is handed to set several right values at once, as Python."""
    from wrong_values import right

    values = {name: right(value) for name, value in flags.items()}
    if door == "command line":
        flat = [[f"--{name.replace('_', '-')}", *each.words] for name, each in values.items()]
        return [*TRAIN, *(word for words in flat for word in words)]
    if door == "file":
        # Each section once, however many of its settings.
        ordered = sorted(values.items(), key=lambda pair: pair[0].rpartition(".")[0])
        return "\n".join(f"{name} = {each.toml}" for name, each in ordered) + "\n"
    if door == "experiment":
        return experiment({name: each.toml for name, each in values.items()})
    return {name: each.python for name, each in values.items()}


def experiment(settings):
    """An experiment of one arm with these settings, as TOML."""
    lines = [f'"{name}" = {value}' for name, value in settings.items()]
    head = "seeds = 1\nepisodes = 1\nhighway_env_episodes = 0\n[arms.one]\n"
    return f'{head}controller = "hierarchical"\n[arms.one.settings]\n' + "\n".join(lines) + "\n"


@contextlib.contextmanager
def folder():
    """A working folder with nothing in it but one that is taken."""
    before = os.getcwd()
    with tempfile.TemporaryDirectory() as place:
        os.chdir(place)
        Path(TAKEN).mkdir()
        Path(TAKEN, "notes.txt").write_text("mine")
        try:
            yield Path(place)
        finally:
            os.chdir(before)


def meet(mistake):
    """Let a mistake in at its door, inside `folder`."""
    before, there = _files(), sys.modules.keys() & set(HEAVY)
    try:
        by_command = mistake.door in COMMANDS
        given = command(mistake) if by_command else mistake.given
        refused, message = DOORS[mistake.door](given)
        wrong = ""
    except (Exception, SystemExit) as error:
        refused, message = False, str(error)[:500]
        wrong = f"{type(error).__name__} instead of an error for people"
    left = _files() - before
    if left:
        wrong = wrong or f"left behind: {sorted(left)}"
    if mistake.door in LIGHT and (heavy := (sys.modules.keys() & set(HEAVY)) - there):
        wrong = wrong or f"imported {sorted(heavy)}"
    lines = message.splitlines()
    if len(lines) > 2 or max(map(len, lines), default=0) > 250:
        wrong = wrong or "a message of more than two lines, or too long ones"
    if any(text in message for text in LET_IN):
        refused, wrong = False, wrong or "not refused"
    return Met(refused, message, wrong)


def _files():
    return {str(path) for path in Path().rglob("*")} - {"wrong.toml"}


def _command(words):
    """The command line in this process: (refused, its message)."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(words)
    said = err.getvalue().rstrip("\n")
    start = "lanewise: error: "
    return code == 2 and said.startswith(start) and not out.getvalue(), said.removeprefix(start)


def command(mistake, out=TAKEN):
    """The words of a command line that make a mistake of a light door; writes its file."""
    if isinstance(mistake.given, str):
        Path("wrong.toml").write_text(mistake.given)
    words = {
        "file": (*TRAIN, "--settings", "wrong.toml"),
        "experiment": ("reproduce", "--out", TAKEN, "--experiment", "wrong.toml"),
    }.get(mistake.door, mistake.given)
    return [out if word == TAKEN else word for word in words]


def _python(call, *positional, **keywords):
    try:
        call(*positional, **keywords)
    except LanewiseError as error:
        return True, str(error)
    return False, "not refused"


def _compose(keywords):
    return _python(config.compose, **keywords)


def _train(keywords):
    import lanewise

    with contextlib.redirect_stderr(io.StringIO()):
        return _python(lanewise.train, TAKEN, **keywords)


def _environment(keywords):
    import gymnasium

    return _python(gymnasium.make, "lanewise/Trap-v0", **keywords)


def _environments(keywords):
    import gymnasium

    return _python(gymnasium.make_vec, "lanewise/Trap-v0", **keywords)


DOORS = {
    "command line": _command,
    "command": _command,
    "file": _command,
    "experiment": _command,
    "compose": lambda flags: _python(config.compose, flags=flags),
    "compose's arguments": _compose,
    "lanewise.train": _train,
    "gymnasium.make": _environment,
    "gymnasium.make_vec": _environments,
}
SETTING_DOORS = (
    "command line",
    "file",
    "experiment",
    "compose",
    "lanewise.train",
    "gymnasium.make",
)
"""Those that take a setting by its dotted name."""
