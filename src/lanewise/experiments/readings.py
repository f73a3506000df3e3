"""What the paper leaves open, row by row, and how it is read under given settings. No JAX."""

import json
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any

from lanewise import config
from lanewise.controllers.registry import CONTROLLERS, TRAINABLE
from lanewise.report.markup import cell

_QUOTED = re.compile(r"`(\*?[a-z_]*(?:\.[a-z_]+)+)`")
HEADS = ("#", "the paper", "here", "literal or other reading", "why")
STAR = (
    "`*` stands for every stage and level that learns: `single_level`, `high_level`, `low_level`, "
    'and `h_dqn` with its two levels. Rows that begin with "stated" are no gaps in the paper.'
)
UNUSED = "not used here"


@dataclass(frozen=True)
class ArmSettings:
    """One of those whose settings are shown."""

    title: str
    controller: str
    settings: Mapping[str, Any]
    """By dotted name."""
    takes_over: bool = False
    """Whether its step 1 is another's."""

    def names(self, quoted: str) -> list[str]:
        """The settings that a quoted one stands for: with a ``*`` those of each that learns."""
        if not quoted.startswith("*"):
            return [quoted]
        ending, _, leaf = quoted[1:].partition(".")
        stages = CONTROLLERS[self.controller].stages
        sections = (each for stage in stages for each in (stage.section, *stage.level_sections))
        return [
            name
            for section in dict.fromkeys(sections)
            if section.endswith(ending) and not (self.takes_over and section == "high_level")
            if (name := f"{section}.{leaf}") in self.settings
        ]


def by_default() -> list[ArmSettings]:
    """Every trained controller with the default settings."""
    return [ArmSettings(name, name, _defaults()) for name in TRAINABLE]


@cache
def rows() -> tuple[Mapping[str, Any], ...]:
    """The rows: `number`, `paper`, `here`, `other` and `why`, in Markdown."""
    text = resources.files(__package__).joinpath("readings.toml").read_text("utf-8")
    return tuple(tomllib.loads(text)["rows"])


def table(arms: Sequence[ArmSettings]) -> str:
    """The rows as a Markdown table, settings with the values they have in these arms."""
    lines = ["| " + " | ".join(HEADS) + " |", "|---" * len(HEADS) + "|"]
    for row in rows():
        here, why = _here(row, arms), _why(row, arms)
        cells = (row["number"], _bars(row["paper"]), here, _bars(row["other"]), _bars(why))
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def sentence(row: Mapping[str, Any], arms: Sequence[ArmSettings]) -> str:
    """One row as Markdown text: its number, what the paper says, what is done here, and why."""
    text = f"**{row['number']}.** {row['paper']}: {_here(row, arms)}"
    why = _why(row, arms)
    return f"{text}. Why: {why}." if why else f"{text}."


def _here(row: Mapping[str, Any], arms: Sequence[ArmSettings]) -> str:
    """What a row says is done here, settings with their values."""
    found = {quoted: _values(quoted, row, arms) for quoted in _QUOTED.findall(row["here"])}
    if not _concerned(row, arms) or (found and not any(found.values())):
        return UNUSED
    return _QUOTED.sub(lambda match: _shown(match[1], found[match[1]]), _bars(row["here"]))


def _why(row: Mapping[str, Any], arms: Sequence[ArmSettings]) -> str:
    """Why the default is what it is; says so where another value is shown."""
    why: str = row["why"]
    for quoted in _QUOTED.findall(row["here"]):
        for name, titles in _values(quoted, row, arms).items():
            if why and titles.keys() != {json.dumps(_defaults()[name])}:
                return f"of the default: {why}"
    return why


def _concerned(row: Mapping[str, Any], arms: Sequence[ArmSettings]) -> list[ArmSettings]:
    """The arms that a row speaks of; all of them unless it names their controllers."""
    return [arm for arm in arms if arm.controller in row.get("controllers", (arm.controller,))]


def _values(
    quoted: str, row: Mapping[str, Any], arms: Sequence[ArmSettings]
) -> dict[str, dict[str, list[str]]]:
    """By setting and value, the titles of the arms that have it."""
    found: dict[str, dict[str, list[str]]] = {}
    for arm in _concerned(row, arms):
        for name in arm.names(quoted):
            value = json.dumps(arm.settings[name])
            found.setdefault(name, {}).setdefault(value, []).append(arm.title)
    return found


def _shown(quoted: str, found: Mapping[str, Mapping[str, Sequence[str]]]) -> str:
    """A setting with its value; by stage and by arm where these differ."""
    values = {value for titles in found.values() for value in titles}
    if quoted.startswith("*.") and len(values) == 1 < len(found):
        return f"`{quoted} = {values.pop()}`"
    order = list(_defaults())
    return ", ".join(_by_arm(name, found[name]) for name in sorted(found, key=order.index))


def _by_arm(name: str, titles: Mapping[str, Sequence[str]]) -> str:
    """A setting with the value that most arms have, and the others with their arms."""
    usual = max(titles, key=lambda value: len(titles[value]))
    rest = ", ".join(
        f"`{value}` in {' and '.join(f'*{cell(title)}*' for title in of)}"
        for value, of in titles.items()
        if value != usual
    )
    return f"`{name} = {usual}`" + (f" ({rest})" if rest else "")


@cache
def _defaults() -> Mapping[str, Any]:
    return config.flatten(config.compose())


def _bars(text: str) -> str:
    """A text whose bars do not end its cell."""
    return text.replace("|", "\\|")
