"""Prints pip constraints that pin every direct requirement to the lowest version that is allowed.

python .ci/lowest.py [EXTRA ...]

Read off pyproject.toml, so that a raised bound needs no second place; needs Python alone.
"""

import re
import sys
import tomllib
from pathlib import Path

PROJECT = Path(__file__).resolve().parent.parent / "pyproject.toml"
_NAME = re.compile(r"([A-Za-z0-9][A-Za-z0-9._-]*)\s*(?:\[([^]]*)\])?\s*([^;]*)")
_LOWEST = re.compile(r"(?:>=|==)\s*([0-9][0-9A-Za-z.]*)")


def direct(project, extras):
    """Requirements of the core and of some extras, with those of extras they name."""
    own, optional = project["name"], project["optional-dependencies"]
    left = [*project["dependencies"]]
    for extra in extras:
        left += optional[extra]
    found = []
    while left:
        requirement = left.pop(0)
        name, named, _ = _NAME.fullmatch(requirement).groups()
        if name == own:
            for extra in named.split(","):
                left += optional[extra.strip()]
        else:
            found.append(requirement)
    return found


def lowest(requirement):
    """The requirement at its lowest version, as a constraint.

    Raises:
        SystemExit: it has no lower bound.
    """
    name, _, versions = _NAME.fullmatch(requirement).groups()
    bound = _LOWEST.search(versions)
    if bound is None:
        raise SystemExit(f"{requirement}: has no lower bound, so nothing tells the oldest version")
    return f"{name}=={bound[1]}"


def main(extras):
    project = tomllib.loads(PROJECT.read_text("utf-8"))["project"]
    print("\n".join(dict.fromkeys(lowest(each) for each in direct(project, extras))))


if __name__ == "__main__":
    main(sys.argv[1:])
