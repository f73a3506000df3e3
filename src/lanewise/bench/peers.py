"""Where the peers live: in this interpreter or in others, each asked what is installed for it."""

import json
import subprocess
import sys
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from lanewise.errors import LanewiseError

NEEDS = {
    "highway-env": ("highway-env", "lanewise"),
    "EnvPool": ("envpool",),
    "PyTorch": ("torch",),
    "Stable-Baselines3": ("stable_baselines3", "torch"),
    "Stable-Baselines3 on highway-env": ("stable_baselines3", "highway-env", "lanewise"),
}
"""Distributions that must be installed beside one another to measure a peer."""
ASK = """
import json, sys
from importlib.metadata import PackageNotFoundError, version
found = {}
for name in json.loads(sys.argv[1]):
    try:
        found[name] = version(name)
    except PackageNotFoundError:
        pass
print(json.dumps(found))
"""


@dataclass(frozen=True)
class Interpreter:
    """A Python interpreter and what is installed for it."""

    path: Path
    versions: dict[str, str]


@dataclass(frozen=True)
class Interpreters:
    """The interpreters at hand, in the order in which they are asked."""

    known: tuple[Interpreter, ...]
    missed: set[str] = field(default_factory=set, compare=False)
    """Peers that were asked for in vain."""

    def find(self, peer: str) -> Path | None:
        """The first interpreter in which a peer of `NEEDS` can be measured, or None."""
        needs = set(NEEDS[peer])
        found = next((one.path for one in self.known if needs <= set(one.versions)), None)
        if found is None:
            self.missed.add(peer)
        return found

    def versions(self) -> dict[str, str]:
        """Versions of the peers' distributions, each where it is measured first."""
        found: dict[str, str] = {}
        for one in self.known:
            found = one.versions | found
        return found


def ask(paths: Iterable[Path]) -> Interpreters:
    """Ask this interpreter and those at ``paths``.

    Raises:
        LanewiseError: one of them is no Python interpreter.
    """
    return Interpreters(tuple(_ask(path) for path in (Path(sys.executable), *paths)))


def _ask(path: Path) -> Interpreter:
    wanted = json.dumps(sorted({name for names in NEEDS.values() for name in names}))
    try:
        answer = subprocess.run(
            [str(path), "-c", ASK, wanted], capture_output=True, text=True, check=True, timeout=60
        )
        versions = json.loads(answer.stdout)
    except (OSError, subprocess.SubprocessError, ValueError) as error:
        raise LanewiseError(
            f"--python: {path} is no Python interpreter; give one such as peers/bin/python"
        ) from error
    return Interpreter(path, versions)
