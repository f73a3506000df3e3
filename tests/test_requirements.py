"""The locked versions belong to the ranges of pyproject.toml, and every range has its lowest."""

import re
import tomllib
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
LOCK = (ROOT / "requirements/ci.txt").read_text("utf-8")
PIN = re.compile(
    r"^([a-z0-9-]+)==(\S+)(?: ; [^\\]+)? \\\n((?:    --hash=sha256:[0-9a-f]{64}.*\n)+)", re.M
)


def direct(texts):
    """Requirements, with those of our own extras in their place."""
    found = []
    for text in texts:
        wanted = Requirement(text)
        if wanted.name == PROJECT["name"]:
            for extra in wanted.extras:
                found += direct(PROJECT["optional-dependencies"][extra])
        else:
            found.append(wanted)
    return found


WANTED = direct([*PROJECT["dependencies"], "lanewise[test,docs]"])


def test_the_lock_is_within_the_ranges():
    locked = {}
    for name, version, _ in PIN.findall(LOCK):
        # Some have a version for each Python.
        locked.setdefault(name, []).append(version)
    assert len(WANTED) > 25
    for wanted in WANTED:
        versions = locked.get(canonicalize_name(wanted.name), [])
        assert versions, f"{wanted}: run .ci/lock"
        assert all(map(wanted.specifier.contains, versions)), f"{wanted}: run .ci/lock"


def test_the_lock_holds_pins_with_hashes_alone():
    assert PIN.sub("", LOCK).count("\n") == 1
    assert LOCK.startswith("# Made by .ci/lock")
    assert "://" not in LOCK


def test_every_range_says_its_oldest_version():
    for wanted in direct([*PROJECT["dependencies"], "lanewise[test,docs,examples]"]):
        assert {each.operator for each in wanted.specifier} & {">=", "=="}, wanted
