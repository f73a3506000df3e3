"""Making any string safe inside Markdown, HTML and JSON."""

import re
from html import escape
from math import isfinite
from typing import Any

import numpy as np

from lanewise.errors import printable

_SPECIAL = re.compile(r"([\\`*_\[\]<>|~#$])")


def line(value: object) -> str:
    """A string on one line, as `printable`: nothing in it turns writing around or hides."""
    return printable(" ".join(str(value).split()))


def cell(value: object) -> str:
    """A string as plain Markdown text on one line: nothing in it formats, links or splits."""
    return _SPECIAL.sub(r"\\\1", line(value)).replace("&", "&amp;")


def code(value: object) -> str:
    """A string as one line of Markdown code, whatever backticks it holds."""
    text = line(value)
    fence = "`" * (1 + max((len(run) for run in re.findall(r"`+", text)), default=0))
    # In a table a bar would split the cell even inside code.
    padded = f" {text} " if text.startswith("`") or text.endswith("`") or not text else text
    return f"{fence}{padded}{fence}".replace("|", r"\|")


def html(value: object) -> str:
    """A string as plain HTML text."""
    return escape(printable(str(value)))


def finite(value: Any) -> Any:
    """The same tree with NaN and infinity as null, and NumPy's numbers as Python's.

    Raises:
        TypeError: JSON does not know what something is.
    """
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, dict):
        return {finite(str(key)): finite(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [finite(inner) for inner in value]
    if isinstance(value, float):
        return value if isfinite(value) else None
    if value is None or isinstance(value, bool | int):
        return value
    if not isinstance(value, str):
        raise TypeError(f"{type(value).__name__} is nothing that JSON knows")
    # Half of a surrogate pair, such as stands for a byte in a file's name, is no text to others.
    return value.encode("utf-8", "backslashreplace").decode()
