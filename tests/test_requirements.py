"""The locked versions belong to the ranges of pyproject.toml, and every range has its lowest."""

import importlib.util
import re
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parent.parent
LOCK = ROOT / "requirements/ci.txt"
PIN = re.compile(
    r"^([a-z0-9-]+)==(\S+)(?: ; [^\\]+)? \\\n((?:    --hash=sha256:[0-9a-f]{64}.*\n)+)", re.M
)


@pytest.fixture(scope="module")
def project():
    return tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))


@pytest.fixture(scope="module")
def lowest():
    """`.ci/lowest.py`."""
    spec = importlib.util.spec_from_file_location("lowest", ROOT / ".ci/lowest.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def pins(text):
    """Locked versions by name; some names have one for each Python."""
    found = {}
    for name, version, _ in PIN.findall(text):
        found.setdefault(name, []).append(version)
    return found


def unmet(requirements, locked):
    """Requirements that the lock does not have, or has in a version outside their range."""
    return [
        text
        for text in requirements
        for wanted in [Requirement(text)]
        for versions in [locked.get(canonicalize_name(wanted.name), [])]
        if not versions or not all(map(wanted.specifier.contains, versions))
    ]


def test_the_lock_is_within_the_ranges(project, lowest):
    wanted = lowest.direct(project["project"], ["test", "docs"])
    assert len(wanted) > 25
    assert unmet(wanted, pins(LOCK.read_text("utf-8"))) == [], "run .ci/lock"


def test_the_lock_holds_pins_with_hashes_alone():
    text = LOCK.read_text("utf-8")
    assert PIN.sub("", text).count("\n") == 1
    assert text.startswith("# Made by .ci/lock")
    assert "://" not in text


def test_the_oldest_versions_are_the_lower_bounds(project, lowest):
    oldest = [lowest.lowest(each) for each in lowest.direct(project["project"], ["test"])]
    assert "numpy==2.0" in oldest
    assert "highway-env==1.12.1" in oldest
    assert {line.partition("==")[0] for line in oldest} >= {"jax", "matplotlib", "onnx", "pytest"}
    assert lowest.lowest("jax[cuda13]>=0.10.2,<0.11") == "jax==0.10.2"
    with pytest.raises(SystemExit, match="rich<14: has no lower bound"):
        lowest.lowest("rich<14")
