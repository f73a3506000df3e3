"""Making any string safe inside Markdown, HTML and JSON."""

import re
from html import escape
from math import isfinite
from typing import Any

_SPECIAL = re.compile(r"([\\`*_\[\]<>|~#$])")


def cell(value: object) -> str:
    """A string as plain Markdown text on one line: nothing in it formats, links or splits."""
    return _SPECIAL.sub(r"\\\1", " ".join(str(value).split())).replace("&", "&amp;")


def code(value: object) -> str:
    """A string as one line of Markdown code, whatever backticks it holds."""
    line = " ".join(str(value).split())
    fence = "`" * (1 + max((len(run) for run in re.findall(r"`+", line)), default=0))
    # In a table a bar would split the cell even inside code.
    padded = f" {line} " if line.startswith("`") or line.endswith("`") or not line else line
    return f"{fence}{padded}{fence}".replace("|", r"\|")


def html(value: object) -> str:
    """A string as plain HTML text."""
    return escape(str(value))


def finite(value: Any) -> Any:
    """The same tree with NaN and infinity as null, and anything JSON does not know as text."""
    if isinstance(value, dict):
        return {str(key): finite(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [finite(inner) for inner in value]
    if isinstance(value, float):
        return value if isfinite(value) else None
    return value if value is None or isinstance(value, bool | int | str) else str(value)
