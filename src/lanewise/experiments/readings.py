"""What the paper leaves open, row by row, and how it is read under given settings. No JAX."""

import json
import re
import tomllib
from collections.abc import Mapping
from functools import cache
from importlib import resources
from typing import Any

_QUOTED = re.compile(r"`([a-z_]+(?:\.[a-z_]+)+)`")
HEADS = ("#", "the paper", "here", "literal or other reading", "why")


@cache
def rows() -> tuple[Mapping[str, str], ...]:
    """The rows: `number`, `paper`, `here`, `other` and `why`, in Markdown."""
    text = resources.files(__package__).joinpath("readings.toml").read_text("utf-8")
    return tuple(tomllib.loads(text)["rows"])


def table(flat: Mapping[str, Any]) -> str:
    """The rows as a Markdown table, settings with the values they have in ``flat``."""
    lines = ["| " + " | ".join(HEADS) + " |", "|---" * len(HEADS) + "|"]
    for row in rows():
        cells = (row["number"], row["paper"], _here(row, flat), row["other"], row["why"])
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(lines) + "\n"


def sentence(row: Mapping[str, str], flat: Mapping[str, Any]) -> str:
    """One row as Markdown text: its number, what the paper says, what is done here, and why."""
    text = f"**{row['number']}.** {row['paper']}: {_here(row, flat)}"
    return f"{text}. Why: {row['why']}." if row["why"] else f"{text}."


def _here(row: Mapping[str, str], flat: Mapping[str, Any]) -> str:
    """What a row says is done here, settings with their values."""
    return _QUOTED.sub(lambda found: _with_value(found[1], flat), row["here"])


def _with_value(name: str, flat: Mapping[str, Any]) -> str:
    """A setting as TOML spells it; a section by its name alone."""
    value = f" = {json.dumps(flat[name])}" if name in flat else ""
    return f"`{name}{value}`"
