"""Making any string safe inside Markdown, HTML and JSON."""

import re
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


def finite(value: Any) -> Any:
    """The same tree for JSON: NaN and infinity are null, NumPy's numbers Python's."""
    match value:
        case np.generic():
            return finite(value.item())
        case dict():
            return {finite(str(key)): finite(inner) for key, inner in value.items()}
        case list() | tuple():
            return [finite(inner) for inner in value]
        case float():
            return value if isfinite(value) else None
        case str():
            # Half of a surrogate pair, which stands for a byte in a file's name, is no text.
            return value.encode("utf-8", "backslashreplace").decode()
    return value
